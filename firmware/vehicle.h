/*
 * vehicle.h - a whole vehicle in one struct: from the counters of its two encoders to what its two motor drivers are told.
 *
 *     status = vehicle_init(&self, &settings);          before anything moves: refuses what cannot work
 *     status = vehicle_step(&self, counts, missed, command);  at each tick
 *
 * A step: counts -> angles turned -> wheel rates, filtered -> pose (dead reckoning) -> where on the path, how fast -> the law of
 * that line or arc -> torques within their limits -> watchdog -> motor commands. Right wheel first, always.
 *
 * Wheel rates. A rate is measured in steps of 2 pi / (counts_per_turn dt) rad/s, and is the mean over the tick, so it is dt / 2
 * old. The filter rate += (measured - rate) dt / (smoothing + dt) has gain 1 for a constant rate, lags exactly `smoothing`
 * behind one that grows evenly, and lets through dt / (smoothing + dt) of a step of one count. To the outer loop hold, difference
 * and filter are a delay of dt + smoothing, which takes a loop with a fastest pole p some p (dt + smoothing) rad of its phase
 * margin: below 0.1 rad it hardly shows. Back EMF is made up for at the rate that is not filtered, dt old in the middle of the
 * hold: with MOTOR_VOLTAGE a wheel then feels some K E dt / R kg m^2 heavier than it is (motor.h has K, E and R).
 *
 * The heading is kept within a turn or so of zero, so that its digits in float are worth as much after hours as at the start.
 *
 * A tick that shows more turning than a wheel can do (a count misread) is an error, and neither pose nor rates take it in; the
 * next good tick has the whole way since the last good one. So nothing of the way is lost.
 *
 * Whatever happens, the command is finite and within the motors' limits; in WATCHDOG_STOP it is zero (motor.h says what that
 * does), and the pose is reckoned on. Only vehicle_reset leaves that state.
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
    float period;                        /* s: from tick to tick */
    float counts_per_turn[2];            /* of a wheel, gear and quadrature included; negative where they go down forward */
    int counter_bits;                    /* 2 to 32 */
    float smoothing;                     /* s: time constant of the filter of wheel rates; 0: none */
    float fastest;                       /* rad/s: beyond any rate of a wheel */
    noslip_pose_f start;                 /* of the centre of mass */
    const noslip_segment_f *segments;    /* the path */
    int count;                           /* of segments */
    noslip_path_options_f way;           /* its `ahead` has to be params.d, its W zero: of another law, _offset */
    labmate_type_iv_segment_gains_f gains;
    labmate_options_f limits;            /* on_error does not count here: the watchdog holds, then stops */
    motor_settings motors[2];
    float stuck_torque;                  /* N m: a wheel that more does not turn by a count is stuck; above what a stop needs */
    watchdog_settings watchdog;
} vehicle_settings;

/* A time between two ticks and what goes with it. */
typedef struct vehicle_interval {
    float dt;          /* s */
    float per_dt;      /* 1/s */
    float most_turned; /* rad: by a wheel */
    float share;       /* of the filter */
} vehicle_interval;

/* All the memory of a vehicle: made by init, owned by the caller, to be read, not to be written to. */
typedef struct vehicle {
    const vehicle_settings *settings;
    labmate_state_f state; /* of it the filtered wheel rates; the pose is odometry.pose */
    float torque[2];       /* N m: wanted of the motors now */
    float rate[2];         /* rad/s: of the wheels in the last tick, not filtered */
    float speed;           /* m/s: forward, from the filtered rates */
    labmate_type_iv_segment_reference_f reference;
    labmate_type_iv_segment_config_f place; /* of it L: how far ahead P_l lies; where the path is, it tells at each step */
    labmate_type_iv_segment_f law;
    noslip_path_f path; /* path.guide: where on it */
    noslip_odometry_f odometry;
    noslip_encoder_f encoders[2];
    uint32_t waited; /* ticks since the last good one */
    vehicle_interval usual;
    motor motors[2];
    struct watchdog watchdog;
    int ready; /* set by init */
} vehicle;

/*
 * Makes a vehicle that stands at its start. `settings` and the segments in them stay the caller's and have to stay as they are.
 * NOSLIP_NULL; NOSLIP_NONFINITE or NOSLIP_RANGE for the start; NOSLIP_BAD_PATH; NOSLIP_SINGULAR for a law that has no inverse;
 * NOSLIP_BAD_PARAMETER for anything else, also for counters that would go half round within the ticks that may be missed.
 */
int vehicle_init(vehicle *self, const vehicle_settings *settings);

/*
 * One tick, `missed` of them having been left out just before it: the encoders' counters in, the motors' commands out (N m, A
 * or V). NOSLIP_OK, NOSLIP_SATURATED or NOSLIP_ARRIVED (for good; it stands soon after), or what is wrong in this tick;
 * self->watchdog says whether the vehicle waits for it to pass or has stopped. A vehicle that has stopped answers the error
 * that was the reason, else NOSLIP_NOT_READY.
 */
int vehicle_step(vehicle *self, const uint32_t counts[2], uint32_t missed, float command[2]);

/*
 * Somebody has looked: from WATCHDOG_STOP back to the path where it was left. The pose is as good as the counts were: after many
 * missed or misread ticks tell it anew, noslip_odometry_correct_f(&self->odometry, &truth, NOSLIP_RESET).
 */
int vehicle_reset(vehicle *self);

#ifdef __cplusplus
}
#endif

#endif
