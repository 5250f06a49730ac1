/* clock.h - what wakes a board at a fixed rate: boards/systick.c on Cortex-M, boards/clint.c on RISC-V. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

/* The first tick comes `period` (s) later. */
void clock_start(float period);

/* Sleeps until the next tick; answers how many came since the last one that were not waited for. */
uint32_t clock_wait(void);

#endif
