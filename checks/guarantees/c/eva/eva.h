/* eva.h - shared by the programs for Frama-C's EVA, which are analysed and never run. */
#include <__fc_builtin.h>
#include <float.h>

#include "noslip_controller.h"

#define GLUE_(a, b) a##b
#define GLUE(a, b) GLUE_(a, b)
#define OF(name) GLUE(name, SUFFIX)
#define COUNT(array) ((int)(sizeof(array) / sizeof(*(array))))

/* Arbitrary bits in an object: any number, infinity or NaN. */
#define ANY(object) Frama_C_make_unknown((char *)&(object), sizeof(object))

/* Any number from low to high. */
#define BETWEEN(low, high) GLUE(GLUE(Frama_C_, REAL), _interval)(low, high)

/* Marks a place that the analysis must reach; the check fails if it does not, since it would prove nothing. */
#define REACHED(name) GLUE(Frama_C_show_each_reached_, name)()

extern volatile int any_int;

/* A number with arbitrary bits. */
static REAL any_real(void)
{
    REAL value;
    ANY(value);
    return value;
}
