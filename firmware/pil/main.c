/*
 * main.c - reads requests (see pil.h) from standard input and writes answers to standard output: those of QEMU, by semihosting, or
 * of a host computer. The exit code is 0 if the input ends between two requests, else 1.
 */
#include "pil.h"

#if __STDC_HOSTED__
#include <stdio.h>

static int start(void)
{
    return 1;
}

static uint32_t get(void *to, uint32_t size)
{
    return (uint32_t)fread(to, 1, size, stdin);
}

static uint32_t put(const void *from, uint32_t size)
{
    const uint32_t done = (uint32_t)fwrite(from, 1, size, stdout);
    return fflush(stdout) == 0 ? done : 0;
}

#else
#include "semihosting.h"

static uint32_t files[2]; /* to read from, to write to */

static int start(void)
{
    static const char *const names[2] = {"/dev/stdin", "/dev/stdout"};
    static const uint32_t lengths[2] = {10, 11}, modes[2] = {1 /* rb */, 5 /* wb */};
    int i, opened = 1;
    for (i = 0; i < 2; i++) {
        const uint32_t open[3] = {(uint32_t)(uintptr_t)names[i], modes[i], lengths[i]};
        const int file = semihosting(SEMIHOSTING_OPEN, open);
        files[i] = (uint32_t)file;
        opened = opened && file >= 0;
    }
    return opened;
}

/* Both return the number of bytes transferred; semihosting returns the number not transferred. */
static uint32_t get(void *to, uint32_t size)
{
    uint32_t left = size;
    while (left > 0) {
        const uint32_t read[3] = {files[0], (uint32_t)(uintptr_t)to + (size - left), left};
        const uint32_t not_read = (uint32_t)semihosting(SEMIHOSTING_READ, read);
        if (not_read >= left) {
            break;
        }
        left = not_read;
    }
    return size - left;
}

static uint32_t put(const void *from, uint32_t size)
{
    const uint32_t write[3] = {files[1], (uint32_t)(uintptr_t)from, size};
    return size - (uint32_t)semihosting(SEMIHOSTING_WRITE, write);
}
#endif

static pil served;

/* Handles one request; returns 0 on an error. */
static int serve(void)
{
    if (pil_check(&served) == PIL_FAULT_NONE) {
        if (get(&served.input, served.request.size) != served.request.size) {
            return 0;
        }
        pil_call(&served);
    }
    return put(&served.answer, sizeof served.answer) == sizeof served.answer &&
           put(&served.output, served.answer.size) == served.answer.size && served.answer.fault == PIL_FAULT_NONE;
}

int main(void)
{
    uint32_t got;
    if (!start()) {
        return 1;
    }
    do {
        got = get(&served.request, sizeof served.request);
    } while (got == sizeof served.request && serve());
    return got == 0 ? 0 : 1;
}
