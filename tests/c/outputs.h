/*
 * outputs.h - a look at an output before every access to memory that the code under test makes, as another task could have it.
 *
 * The code under test is compiled with -fsanitize=thread and linked without that library: the functions that it calls before
 * each access are those of outputs.c. From watch() to unwatch() they count how often each word of the output changes. An output
 * that is written once changes once at most.
 */
#ifndef OUTPUTS_H
#define OUTPUTS_H

#include <stddef.h>

void watch(void *output, size_t size);
int unwatch(void);

#endif
