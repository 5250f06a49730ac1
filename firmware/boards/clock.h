/* clock.h - timer that wakes a board at a fixed rate: boards/systick.c on Cortex-M, boards/clint.c on RISC-V. */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdint.h>

/* Starts the timer; the first tick comes `period` (s) later. */
void clock_start(float period);

/* Sleeps until the next tick; returns the number of ticks missed since the last call. */
uint32_t clock_wait(void);

#endif
