/* string.c - volatile, so that no compiler makes the loops into calls of themselves. */
#include "string.h"

void *memcpy(void *to, const void *from, size_t size)
{
    volatile unsigned char *next = to;
    const unsigned char *source = from;
    while (size-- > 0) {
        *next++ = *source++;
    }
    return to;
}

void *memset(void *to, int value, size_t size)
{
    volatile unsigned char *next = to;
    while (size-- > 0) {
        *next++ = (unsigned char)value;
    }
    return to;
}
