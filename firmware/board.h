/*
 * board.h - functions that a board provides to main: periodic ticks, two encoder counters, two motor drivers, a hardware watchdog,
 * a line for telemetry, and a report at the end.
 *
 * A board is one .c file in boards/ with start-up code and a linker script. It may access registers and use static memory. It does
 * not depend on noslip, except for the simulated vehicle.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

/* Exit code of main, if the board can report it. */
enum {
    BOARD_ARRIVED = 0,
    BOARD_REFUSED = 1, /* labmate_follower_init_f rejected the config */
    BOARD_STOPPED = 2, /* the watchdog of the vehicle stopped it */
    BOARD_LATE = 3,    /* it did not arrive in time */
    BOARD_ASTRAY = 4,  /* it arrived, but too far from the end of the path */
    BOARD_RESTARTED = 5, /* the hardware watchdog caused the reset: an operator must check the vehicle before it continues */
    BOARD_FAULT = 255  /* the processor took an exception */
};

typedef struct board_report {
    int code;           /* BOARD_... */
    int status;         /* last return value of labmate_follower_tick_f */
    int reason;         /* of the watchdog of the vehicle */
    uint32_t ticks;     /* executed */
    uint32_t missed;    /* ticks missed */
    float x, y, heading; /* m, m, rad: pose from dead reckoning */
    float error;        /* m: distance of P_l from the end of the path */
} board_report;

/* Sets up clock, counters and drivers with the motors off; the first tick is `period` (s) later. Returns 0 or BOARD_RESTARTED. */
int board_start(float period);

/* Sleeps until the next tick; returns the number of ticks missed since the last call. */
uint32_t board_wait(void);

/* Reads the counters of the encoders, right and left. */
void board_read(uint32_t counts[2]);

/* Sets the commands of the motor drivers, right and left; zero must be safe. */
void board_drive(const float command[2]);

/* Feeds the hardware watchdog, which resets the processor if this is not called for some ticks. */
void board_alive(void);

/* Returns how many bytes of telemetry the board takes now, without waiting; 0 at the least. */
uint32_t board_room(void);

/* Sends bytes of telemetry, at most board_room(). */
void board_send(const uint8_t *bytes, uint32_t count);

/* Prints the report if the board can; the motors are off. Returns the exit code, report->code unless the board finds an error. */
int board_end(const board_report *report);

#endif
