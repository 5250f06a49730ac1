/* law_digest_bare.c - main on a bare target in QEMU: the digest of STATES and DOUBLES states, written to QEMU's console. */
#include "law_digest_line.h"
#include "semihosting.h"

int main(void)
{
    (void)semihosting(SEMIHOSTING_WRITE0, law_digest(STATES, DOUBLES));
    return 0;
}
