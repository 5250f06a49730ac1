/* console.h - output of the self-test: the console of QEMU or a debugger (semihosting), or standard output. */
#ifndef CONSOLE_H
#define CONSOLE_H

#if __STDC_HOSTED__
#include <stdio.h>

static inline void say(const char *text)
{
    (void)fputs(text, stdout);
}

#else /* without a debugger, a board stops at the first output: call the function of your serial port here instead */
#include "semihosting.h"

static inline void say(const char *text)
{
    (void)semihosting(SEMIHOSTING_WRITE0, text);
}
#endif

static inline void say_number(unsigned number)
{
    char digits[16];
    char *first = digits + sizeof digits - 1;
    *first = '\0';
    do {
        *--first = (char)('0' + number % 10u);
        number /= 10u;
    } while (number > 0);
    say(first);
}

#endif
