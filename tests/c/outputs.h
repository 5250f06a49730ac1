/*
 * outputs.h - inspects an output before every memory access of the code under test, as another task could read it.
 *
 * The code under test is compiled with -fsanitize=thread and linked without that library: the functions that it calls before
 * each access are those of outputs.c. From watch() to unwatch() they count how often each word of the output changes: at most once if
 * it is written once.
 */
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include <stddef.h>

void watch(void *output, size_t size);
int unwatch(void);

#endif
