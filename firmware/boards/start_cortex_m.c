/*
 * start_cortex_m.c - reset of a Cortex-M with an FPU: enables the FPU, initializes memory, calls main.
 *
 * The return value of main becomes the exit code of QEMU (semihosting). Without a debugger or QEMU this call causes a lockup, which
 * lasts until a hardware watchdog resets the processor.
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

/* Handler of the tick, replaced by programs that have one. */
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

/* Vector table: initial stack pointer, reset, faults and unused exceptions, tick. */
__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    void (*handlers[15])(void);
} vectors = {stack_top, {reset, fault, fault, fault, fault, fault, 0, 0, 0, 0, fault, fault, 0, fault, sys_tick}};
