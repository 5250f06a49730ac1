/*
 * vehicle.h - control of a complete vehicle, from the counters of its two encoders to the commands of its two motor drivers.
 *
 *     status = vehicle_init(&self, &settings);                before anything moves: rejects invalid settings
 *     status = vehicle_step(&self, counts, missed, command);  at each tick
 *
 * A step computes: counts -> wheel angles -> filtered wheel rates -> pose (dead reckoning) -> position on the path and desired speed
 * -> law -> torques within their limits -> watchdog -> motor commands. The right wheel is always first.
 *
 * Wheel rates. The resolution of a rate is 2 pi / (counts_per_turn dt) rad/s. The rate is the mean over the tick, a delay of dt / 2.
 * The filter rate += (measured - rate) dt / (smoothing + dt) has gain 1 at constant rate, a lag of `smoothing` at constant
 * acceleration, and attenuates a step of one count to dt / (smoothing + dt). For the outer loop, hold, difference and filter act as
 * a delay of dt + smoothing, which reduces the phase margin of a loop with fastest pole p by about p (dt + smoothing) rad; below
 * 0.1 rad the effect is small. Back EMF is compensated at the unfiltered rate, which is dt old in the middle of the hold. With
 * MOTOR_VOLTAGE this adds about K E dt / R kg m^2 to the inertia of a wheel (K, E and R: see motor.h).
 *
 * The heading is kept near zero by subtracting whole turns, so that the resolution of float does not decrease with time.
 *
 * A tick in which a wheel turned farther than possible (a misread counter) is an error and does not change pose or rates. The next
 * valid tick contains the whole distance since the last valid one, so that no distance is lost.
 *
 * The command is always finite and within the limits of the motors. In WATCHDOG_STOP it is zero (for the effect see motor.h), and
 * dead reckoning continues. Only vehicle_reset leaves this state.
 */
#ifndef VEHICLE_H
#define VEHICLE_H

#include "labmate_type_iv_segment_f.h"
#include "motor.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#include "watchdog.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct vehicle_settings {
    labmate_params_f params;
    float period;                        /* s: time between ticks */
    float counts_per_turn[2];            /* of a wheel, with gear and quadrature; negative if the counter decreases when driving forward */
    int counter_bits;                    /* 2 to 32 */
    float smoothing;                     /* s: time constant of the filter of wheel rates; 0: none */
    float fastest;                       /* rad/s: upper bound of the rate of a wheel */
    noslip_pose_f start;                 /* of the centre of mass */
    const noslip_segment_f *segments;    /* the path */
    int count;                           /* of segments */
    noslip_path_options_f path_options;  /* `ahead` must equal params.d; W must be zero (it requires a law with suffix _offset) */
    labmate_type_iv_segment_gains_f gains;
    labmate_options_f limits;            /* on_error has no effect here: the watchdog holds the torques, then stops */
    motor_settings motors[2];
    float stuck_torque;                  /* N m: a wheel that does not move at a larger torque is stuck; must exceed the torque needed at a stop */
    watchdog_settings watchdog;
} vehicle_settings;

/* A time between two ticks and the quantities that depend on it. */
typedef struct vehicle_interval {
    float dt;          /* s */
    float inverse_dt;  /* 1/s */
    float max_angle;   /* rad: largest possible rotation of a wheel */
    float filter_gain; /* of the filter of wheel rates */
} vehicle_interval;

/* Complete state of a vehicle: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct vehicle {
    const vehicle_settings *settings;
    labmate_state_f state; /* contains the filtered wheel rates only; the pose is odometry.pose */
    float torque[2];       /* N m: last torques from the law */
    float rate[2];         /* rad/s: unfiltered wheel rates in the last tick */
    float speed;           /* m/s: forward, from the filtered rates */
    labmate_type_iv_segment_reference_f reference;
    labmate_type_iv_segment_config_f config; /* L only: `follow` of the law does not use the position of the segment */
    labmate_type_iv_segment_f law;
    noslip_path_f path; /* path.guide is the position on it */
    noslip_odometry_f odometry;
    noslip_encoder_f encoders[2];
    uint32_t waited; /* ticks since the last valid one */
    vehicle_interval nominal; /* of one period */
    motor motors[2];
    struct watchdog watchdog;
    int ready; /* set by init */
} vehicle;

/*
 * Initializes a vehicle at rest at its start pose. `settings` and its segments are not copied: the caller must keep them unchanged.
 * Errors: NOSLIP_NULL; NOSLIP_NONFINITE or NOSLIP_RANGE for the start; NOSLIP_BAD_PATH; NOSLIP_SINGULAR if the law is singular;
 * NOSLIP_BAD_PARAMETER for any other setting, and if a counter could change by half its range within the ticks tolerated.
 */
int vehicle_init(vehicle *self, const vehicle_settings *settings);

/*
 * Computes the motor commands (N m, A or V) of one tick from the counters of the encoders; `missed` is the number of ticks left out
 * before it. Returns NOSLIP_OK, NOSLIP_SATURATED or NOSLIP_ARRIVED (at every tick from the end of the path on; the vehicle stops
 * soon after), or the error of this tick. self->watchdog.state tells whether the last torques are held or the vehicle has stopped.
 * After a stop, returns the error that caused it, or NOSLIP_NOT_READY if it was not an error.
 */
int vehicle_step(vehicle *self, const uint32_t counts[2], uint32_t missed, float command[2]);

/*
 * Leaves WATCHDOG_STOP, after an operator has checked the vehicle; it continues on the path where it stopped. The pose is only as
 * accurate as the counts: after many missed or misread ticks correct it with
 * noslip_odometry_correct_f(&self->odometry, &truth, NOSLIP_RESET).
 */
int vehicle_reset(vehicle *self);

#ifdef __cplusplus
}
#endif

#endif
