/*
 * stopwatch.h - measures the cost of code: instructions on RISC-V, processor cycles on a Cortex-M (SysTick), nothing elsewhere. QEMU
 * does not count cycles; there STOPWATCH_INSTRUCTIONS is the number of instructions per tick of SysTick.
 */
#ifndef STOPWATCH_H
#define STOPWATCH_H

#include <stdint.h>

#if !__STDC_HOSTED__ && defined(__riscv)
#define STOPWATCH_COUNTS "instructions"

static uint32_t stopwatch_read(void)
{
    register uint32_t count __asm__("a0");
    __asm__ volatile(".word 0xb0202573" : "=r"(count) : : "memory"); /* csrr a0, minstret */
    return count;
}

static uint32_t stopwatch_since(uint32_t start)
{
    return stopwatch_read() - start;
}

#elif !__STDC_HOSTED__ && defined(__arm__)
#ifdef STOPWATCH_INSTRUCTIONS
#define STOPWATCH_COUNTS "instructions"
#else
#define STOPWATCH_COUNTS "cycles"
#define STOPWATCH_INSTRUCTIONS 1u
#endif
#define STOPWATCH_MASK 0xffffffu /* 24 bits, counting down */

static uint32_t stopwatch_read(void)
{
    volatile uint32_t *const systick = (volatile uint32_t *)0xe000e010u;
    if ((systick[0] & 1u) == 0) {
        systick[1] = STOPWATCH_MASK;
        systick[2] = 0;
        systick[0] = 5; /* the processor's clock, no interrupt, on */
    }
    return systick[2];
}

static uint32_t stopwatch_since(uint32_t start)
{
    return ((start - stopwatch_read()) & STOPWATCH_MASK) * STOPWATCH_INSTRUCTIONS;
}

#else
#define STOPWATCH_COUNTS ""

static uint32_t stopwatch_read(void)
{
    return 0;
}

static uint32_t stopwatch_since(uint32_t start)
{
    return start;
}
#endif

#endif
