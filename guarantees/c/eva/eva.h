/* eva.h - what the programs for Frama-C's EVA share. They are analysed, never run. */
#include <__fc_builtin.h>
#include <float.h>

#include "noslip_controller.h"

#define GLUE_(a, b) a##b
#define GLUE(a, b) GLUE_(a, b)
#define OF(name) GLUE(name, SUFFIX)
#define COUNT(array) ((int)(sizeof(array) / sizeof(*(array))))

/* Any bits at all in an object: every number, infinities, NaN. */
#define ANY(object) Frama_C_make_unknown((char *)&(object), sizeof(object))

/* Any number from low to high. */
#define BETWEEN(low, high) GLUE(GLUE(Frama_C_, REAL), _interval)(low, high)

/* Tells that the analysis comes here: a check whose places are not all reached proves nothing, and fails. */
#define REACHED(name) GLUE(Frama_C_show_each_reached_, name)()

extern volatile int any_int;

/* Any bits as a number. */
static REAL any_real(void)
{
    REAL value;
    ANY(value);
    return value;
}
