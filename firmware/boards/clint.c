/*
 * clint.c - ticks from the timer of QEMU's RISC-V board, which counts at 10 MHz.
 *
 * The interrupt of the timer ends the sleep but is never taken; the clock tells whether the tick has come.
 */
#include "clock.h"

#define RATE 10000000.0f                            /* Hz */
#define MTIME ((volatile uint32_t *)0x0200bff8u)    /* low and high word */
#define MTIMECMP ((volatile uint32_t *)0x02004000u) /* the interrupt is pending from this time on */

static uint64_t next, period_counts;

static uint64_t now(void)
{
    uint32_t low, high;
    do {
        high = MTIME[1];
        low = MTIME[0];
    } while (high != MTIME[1]);
    return (uint64_t)high << 32 | low;
}

static void wake_at(uint64_t time)
{
    MTIMECMP[1] = UINT32_MAX; /* no interrupt while only one word is written */
    MTIMECMP[0] = (uint32_t)time;
    MTIMECMP[1] = (uint32_t)(time >> 32);
}

/* Enables the timer interrupt to end a sleep. The instruction is csrs mie, t0 (see start_rv32.c); t0 must not change before it. */
static void enable_timer_wake(void)
{
    register uint32_t timer __asm__("t0") = 0x80;
    __asm__ volatile(".word 0x3042a073" ::"r"(timer));
}

void clock_start(float period)
{
    period_counts = (uint32_t)(period * RATE + 0.5f);
    next = now() + period_counts;
    enable_timer_wake();
}

uint32_t clock_wait(void)
{
    uint32_t missed = 0;
    wake_at(next);
    while (now() < next) {
        __asm__ volatile("wfi" ::: "memory");
    }
    for (next += period_counts; now() >= next; next += period_counts) {
        missed++;
    }
    return missed;
}
