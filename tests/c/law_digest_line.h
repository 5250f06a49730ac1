/* law_digest_line.h - what a target calls. */
#include <stdint.h>

/*
 * Runs all laws at n states. A line in hexadecimal: digest and number of good steps in float, the same in double, digest of
 * sine, cosine and root.
 */
const char *law_digest(uint32_t n);
