/*
 * noslip_velocity.h - commands for drives that take a velocity instead of a torque.
 *
 * A law returns the torques tau that cause the accelerations u of the quasi-velocities nu, such as the rates of the wheels. A drive
 * with a velocity loop of its own is given nu + integral of u: the velocities to which u leads until the next call. With the C of
 * the robot's dynamics, u is the acceleration that tau causes, after all limits of the law:
 *
 *     noslip_velocity_init(&velocity, limits, 2, period);
 *     noslip_velocity_reset(&velocity, nu);                       the measured velocities, at the start
 *
 * At each call of the controller:
 *
 *     status = labmate_type_iv_circle_step(&law, &state, &reference, tau);
 *     error = labmate_dynamics_acceleration(&dynamics, &state, tau, qdot, u);
 *     noslip_velocity_step(&velocity, u, nu, status < 0 ? status : error, period, command);
 *
 * A drive that takes a feed-forward torque beside the velocity is given tau too. docs/drives.md says what to enter, and how to find
 * out which gains are stable behind a drive.
 *
 * Each function exists for double and, with the suffix _f, for float.
 */
#ifndef NOSLIP_VELOCITY_H
#define NOSLIP_VELOCITY_H

#include "noslip_controller.h"

#define NOSLIP_VELOCITIES 8 /* quasi-velocities of a robot, at most */

/* What the drives take. */
typedef enum noslip_drive {
    NOSLIP_DRIVE_TORQUE = 0,   /* torques, or the currents or voltages that cause them: noslip_motor.h */
    NOSLIP_DRIVE_VELOCITY = 1, /* velocities */
    NOSLIP_DRIVE_AS_INT = -0x7fffffff
} noslip_drive;

#define NOSLIP_MODULE "noslip_velocity.inc"
#include "noslip_scalars.inc"

#endif
