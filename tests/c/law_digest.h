/* law_digest.h - what law_digest.inc needs, once for all laws. */
#include <stdio.h>

#include "law_names.h"
