/* noslip_path.c - the double side of noslip_path.h. */
#define NOSLIP_OWN
#include "noslip_controller.h"
#include "noslip_path.h"

#define NOSLIP_REAL double
#define NOSLIP_LARGEST DBL_MAX
#define NOSLIP_EPSILON DBL_EPSILON
#define NOSLIP_SMALLEST DBL_MIN
#define NOSLIP_JOIN 1e-6 /* default of options.gap and options.kink */
#define NOSLIP_NAME(name) name
#include "noslip_path_code.inc"
