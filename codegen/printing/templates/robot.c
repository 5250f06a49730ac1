{% set params, state = own(robot.name ~ "_params"), own(robot.name ~ "_state") %}
@{ head }
#include "@{ own(robot.name) }.h"

int @{ own(robot.name ~ "_default_params") }(@{ params } *params)
{
    if (params == NULL) {
        return NOSLIP_NULL;
    }
{% for p in robot.parameters %}
    params->@{ p.in_c } = @{ literal(p.default) };
{% endfor %}
    return NOSLIP_OK;
}

int @{ own(robot.name ~ "_check_params") }(const @{ params } *params)
{
    if (params == NULL) {
        return NOSLIP_NULL;
    }
    if (@{ refused }) {
        return NOSLIP_BAD_PARAMETER;
    }
    return NOSLIP_OK;
}

int @{ own(robot.name ~ "_check_state") }(const @{ state } *state)
{
    if (state == NULL) {
        return NOSLIP_NULL;
    }
    if (!(@{ finite })) {
        return NOSLIP_NONFINITE;
    }
    return NOSLIP_OK;
}
