/* systick.c - ticks from the system timer of a Cortex-M. CLOCK is its rate in Hz. */
#include "clock.h"

#define SYST_CSR (*(volatile uint32_t *)0xe000e010u) /* control */
#define SYST_RVR (*(volatile uint32_t *)0xe000e014u) /* reload value, 24 bits, counting down */
#define SYST_CVR (*(volatile uint32_t *)0xe000e018u) /* current value */

void sys_tick(void);

static volatile uint32_t ticks;
static uint32_t taken;

void sys_tick(void)
{
    ticks++;
}

void clock_start(float period)
{
    SYST_RVR = (uint32_t)(period * (float)CLOCK + 0.5f) - 1;
    SYST_CVR = 0;
    SYST_CSR = 7; /* the processor's clock, interrupt, on */
}

uint32_t clock_wait(void)
{
    uint32_t missed;
    /* Interrupts are disabled between the test and the sleep, so that no tick is lost there; a pending one still ends the sleep. */
    __asm__ volatile("cpsid i" ::: "memory");
    while (ticks == taken) {
        __asm__ volatile("wfi\n\tcpsie i\n\tisb\n\tcpsid i" ::: "memory");
    }
    missed = ticks - taken - 1;
    taken = ticks;
    __asm__ volatile("cpsie i" ::: "memory");
    return missed;
}
