/*
 * board.h - what a board gives to main: a clock that ticks, two counters, two motor drivers, a watchdog, a last word.
 *
 * A board is one .c file in boards/ beside its start-up code and linker script. Everything here may touch registers and keep
 * memory of its own; nothing of it knows noslip, but for what the simulated vehicle needs.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

/* Why main ended: its exit code, where there is somebody to tell. */
enum {
    BOARD_ARRIVED = 0,
    BOARD_REFUSED = 1, /* vehicle_init did not take the settings */
    BOARD_STOPPED = 2, /* the vehicle's watchdog */
    BOARD_LATE = 3,    /* it did not arrive in time */
    BOARD_ASTRAY = 4,  /* it arrived, but not where it should be */
    BOARD_RESTARTED = 5, /* the hardware watchdog had to reset: whoever looks first decides whether to go on */
    BOARD_FAULT = 255  /* the processor took an exception */
};

typedef struct board_report {
    int code;           /* BOARD_... */
    int status;         /* the last that the vehicle answered */
    int reason;         /* of its watchdog */
    uint32_t ticks;     /* made */
    uint32_t missed;    /* left out */
    float x, y, heading; /* m, m, rad: the pose that was reckoned */
    float error;        /* m: from there to where it should be */
} board_report;

/* Sets up clock, counters and drivers, no power on the motors; the first tick is `period` (s) later. 0, or BOARD_RESTARTED. */
int board_start(float period);

/* Sleeps until the next tick; answers how many were missed since the last one, because it was waited for too late. */
uint32_t board_wait(void);

/* The encoders' counters, right and left. */
void board_read(uint32_t counts[2]);

/* What the motor drivers are told, right and left; zeros are safe. */
void board_drive(const float command[2]);

/* The loop is alive: without this call in some ticks the hardware watchdog resets. */
void board_alive(void);

/* The motors are off and stay off. Tells whoever listens; answers the exit code, report->code unless the board knows better. */
int board_end(const board_report *report);

#endif
