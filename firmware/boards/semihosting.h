/* semihosting.h - requests to QEMU or a debugger: operation and argument in the first two registers. */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stdint.h>

enum {
    SEMIHOSTING_OPEN = 0x01,         /* three words: name of a file, mode, length of the name; returns its number */
    SEMIHOSTING_WRITE0 = 0x04,       /* prints a text on the console */
    SEMIHOSTING_WRITE = 0x05,        /* three words: number of a file, address, bytes; returns the number of bytes not written */
    SEMIHOSTING_READ = 0x06,         /* the same for reading */
    SEMIHOSTING_COMMAND_LINE = 0x15, /* two words: address and size of memory for the text and its end; returns 0 on success */
    SEMIHOSTING_EXIT_EXTENDED = 0x20 /* two words: reason and exit code */
};

static inline int semihosting(int operation, const void *argument)
{
#if defined(__arm__)
    register int answer __asm__("r0") = operation;
    register const void *given __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(answer) : "r"(given) : "memory");
#else /* the three instructions must be in one page */
    register int answer __asm__("a0") = operation;
    register const void *given __asm__("a1") = argument;
    __asm__ volatile(".balign 16\n\t.option push\n\t.option norvc\n\tslli x0, x0, 31\n\tebreak\n\tsrai x0, x0, 7\n\t.option pop"
                     : "+r"(answer)
                     : "r"(given)
                     : "memory");
#endif
    return answer;
}

#endif
