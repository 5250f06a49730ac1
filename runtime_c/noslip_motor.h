/*
 * noslip_motor.h - command of a motor driver for a desired torque at the wheel: a DC motor with a gear.
 *
 *     torque = E current e - friction rate - dry_friction sign(rate)     E = torque_constant gear, N m of the wheel per A
 *     voltage = resistance current + E rate
 *
 * The factor e is `efficiency` where power flows from the motor to the wheel, and 1 / back_efficiency where it flows back. Torque and
 * rate are those of the wheel, positive when it rolls forward. A motor that is mounted the other way round has a negative gear ratio:
 * its current and voltage are negative when driving forward. The inductance of the winding is neglected, which requires L / R much
 * shorter than a tick. A brushless motor with a current loop is a DC motor here.
 *
 * At standstill the direction of friction is unknown, and a measured rate changes its sign there. Below the rate `moving`, dry friction
 * and the change to back_efficiency are therefore compensated in proportion to the rate, so that the command is continuous. At
 * standstill the gear counts as driven by the motor.
 *
 * The command is limited by the maximum current and the supply voltage. A command of zero is safe: 0 V shorts the winding and
 * brakes, 0 A lets the wheel roll. What the motor can do at its present rate is given to the law as its limits, so that the law slows
 * down or keeps its path within it:
 *
 *     noslip_motor_init(&motor, &settings);
 *     noslip_motor_limit(&motor, rate, &limit);                       at each tick, before the step of the law
 *     noslip_motor_step(&motor, tau[0], rate, &command);              after it
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_MOTOR_H
#define NOSLIP_MOTOR_H

#include "noslip_controller.h"

/* Kind of command that the driver takes. */
typedef enum noslip_motor_mode {
    NOSLIP_MOTOR_TORQUE = 0,  /* N m, unchanged: the driver contains the motor model */
    NOSLIP_MOTOR_CURRENT = 1, /* A */
    NOSLIP_MOTOR_VOLTAGE = 2, /* V */
    NOSLIP_MOTOR_DUTY = 3,    /* voltage as a part of the supply, -1 to 1: PWM of a bridge */
    NOSLIP_MOTOR_MODE_AS_INT = -0x7fffffff
} noslip_motor_mode;

#define NOSLIP_MODULE "noslip_motor.inc"
#include "noslip_scalars.inc"

#endif
