#include "noslip_status.h"

const char *noslip_status_name(int status)
{
    switch (status) {
    case NOSLIP_OK: return "ok";
    case NOSLIP_SATURATED: return "saturated";
    case NOSLIP_ARRIVED: return "arrived";
    case NOSLIP_GRIP_LIMITED: return "grip";
    case NOSLIP_WILL_SLIP: return "will_slip";
    case NOSLIP_SLIPPING: return "slipping";
    case NOSLIP_REJECTED: return "rejected";
    case NOSLIP_NULL: return "null";
    case NOSLIP_NONFINITE: return "nonfinite";
    case NOSLIP_RANGE: return "range";
    case NOSLIP_BAD_PARAMETER: return "bad_parameter";
    case NOSLIP_SINGULAR: return "singular";
    case NOSLIP_NOT_READY: return "not_ready";
    case NOSLIP_BAD_PATH: return "bad_path";
    case NOSLIP_UNSTABLE: return "unstable";
    case NOSLIP_ASTRAY: return "astray";
    case NOSLIP_DAMAGED: return "damaged";
    case NOSLIP_OTHER_VERSION: return "other_version";
    case NOSLIP_OTHER_MODEL: return "other_model";
    case NOSLIP_FULL: return "full";
    case NOSLIP_DIVERGED: return "diverged";
    default: return "unknown";
    }
}
