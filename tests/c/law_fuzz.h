/* law_fuzz.h - what law_fuzz.inc needs, once for all laws. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "law_names.h"

#define CHECK(condition) \
    if (!(condition)) { \
        fprintf(stderr, "%s: step %lu, status %d, line %d: not %s\n", name, (unsigned long)i, status, __LINE__, #condition); \
        exit(1); \
    }
