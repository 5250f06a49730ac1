/* law_digest_line.h - the function that a target calls. */
#include <stdint.h>

/*
 * Runs all laws at n states in float and at n_double in double. A line in hexadecimal: digest and number of good steps in float,
 * the same in double, digest of sine, cosine and root, and 1 if the target rounds sums of doubles correctly, else 0.
 */
const char *law_digest(uint32_t n, uint32_t n_double);
