/*
 * start_cortex_m.c - reset of a Cortex-M with an FPU: FPU on, memory as C expects it, main, and what comes after.
 *
 * Where main ends, its answer becomes QEMU's exit code (semihosting). Where nobody listens, that call is a fault in a fault: the
 * processor stands still until a hardware watchdog resets it.
 */
#include <stdint.h>

#include "semihosting.h"

extern uint32_t data_start[], data_end[], data_load[], bss_start[], bss_end[], stack_top[];
int main(void);
void reset(void);
void sys_tick(void);

static void leave(uint32_t code)
{
    const uint32_t block[2] = {0x20026u /* application exit */, code};
    for (;;) {
        (void)semihosting(SEMIHOSTING_EXIT_EXTENDED, block);
    }
}

static void fault(void)
{
    leave(255);
}

/* The tick, for programs that have one. */
__attribute__((weak)) void sys_tick(void)
{
    fault();
}

void reset(void)
{
    uint32_t *to;
    const uint32_t *from = data_load;
    *(volatile uint32_t *)0xe000ed88u |= 0xfu << 20; /* CPACR: full access to the FPU */
    __asm__ volatile("dsb\n\tisb");
    for (to = data_start; to < data_end; to++) {
        *to = *from++;
    }
    for (to = bss_start; to < bss_end; to++) {
        *to = 0;
    }
    leave((uint32_t)main());
}

/* What the processor looks up: where the stack begins, then reset, eleven faults and calls that are none of ours, the tick. */
__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*handlers[15])(void);
} vectors = {stack_top, {reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0, fault, sys_tick}};
