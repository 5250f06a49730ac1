/* Reset of QEMU's RISC-V board: sets the stack, enables the FPU if present, calls main, returns its result as QEMU's exit code. */
#include <stdint.h>

int main(void);
void reset(void);

#define EXIT_DEVICE ((volatile uint32_t *)0x100000)

static void leave(uint32_t code)
{
    for (;;) {
        *EXIT_DEVICE = code == 0 ? 0x5555u : code << 16 | 0x3333u;
    }
}

__attribute__((used, aligned(4))) static void fault(void)
{
    leave(255);
}

__attribute__((used)) static void run(void)
{
    leave((uint32_t)main());
}

/* The instructions for control registers are given as numbers: the assembler of GCC rejects their names unless the architecture
 * includes zicsr, which would select other libraries. QEMU itself initializes data and zeroes the rest. */
__attribute__((naked, section(".reset"))) void reset(void)
{
    __asm__ volatile("la sp, stack_top\n"
                     "la t0, fault\n"
                     ".word 0x30529073\n" /* csrw mtvec, t0 */
                     "li t0, 0x6000\n"
                     ".word 0x3002a073\n" /* csrs mstatus, t0: FS */
                     "j run");
}
