/* console.h - where the self-test tells what it found: QEMU's or a debugger's console (semihosting), or standard output. */
#ifndef CONSOLE_H
#define CONSOLE_H

#if __STDC_HOSTED__
#include <stdio.h>

static void say(const char *text)
{
    (void)fputs(text, stdout);
}

#else /* a board without a debugger stops at the first word: put your serial port's function here */
#include "semihosting.h"

static void say(const char *text)
{
    (void)semihosting(SEMIHOSTING_WRITE0, text);
}
#endif

static void say_number(unsigned number)
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
