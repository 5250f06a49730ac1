/* string.c - memcpy and memset. volatile, so that compilers do not replace the loops by calls of these functions. */
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

/* The names that clang calls on ARM, whatever compiles this file. */
#if defined(__arm__)
void *__aeabi_memcpy(void *to, const void *from, size_t size) __attribute__((alias("memcpy")));
void *__aeabi_memcpy4(void *to, const void *from, size_t size) __attribute__((alias("memcpy")));
void *__aeabi_memcpy8(void *to, const void *from, size_t size) __attribute__((alias("memcpy")));
void __aeabi_memclr(void *to, size_t size);
void __aeabi_memclr4(void *to, size_t size) __attribute__((alias("__aeabi_memclr")));
void __aeabi_memclr8(void *to, size_t size) __attribute__((alias("__aeabi_memclr")));

void __aeabi_memclr(void *to, size_t size)
{
    (void)memset(to, 0, size);
}
#endif
