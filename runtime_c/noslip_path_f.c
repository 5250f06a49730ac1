/* noslip_path_f.c - the float side of noslip_path.h. */
#define NOSLIP_OWN
#include "noslip_controller.h"
#include "noslip_path.h"

#define NOSLIP_REAL float
#define NOSLIP_LARGEST FLT_MAX
#define NOSLIP_EPSILON FLT_EPSILON
#define NOSLIP_SMALLEST FLT_MIN
#define NOSLIP_JOIN 1e-4f /* default of options.gap and options.kink */
#define NOSLIP_NAME(name) name##_f
#include "noslip_path_code.inc"
