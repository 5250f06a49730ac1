{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro r(name) %}@{ own(robot ~ "_" ~ name) }{% endmacro %}
{% macro l(name) %}@{ own(law ~ "_" ~ name) }{% endmacro %}
{% macro f(name) %}@{ own(robot ~ "_follower_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_follower") %}
/*
 * @{ self }.h - @{ robot } on a path, from the counters of its wheels to the commands of its drives.
{% for line in banner %}
 * @{ line }
{% endfor %}
 *
 *     status = @{ f("init") }(&follower, &config);             before anything moves: checks the config
 *     status = @{ f("tick") }(&follower, counts, 0, command);  at each tick
 *
 * A tick computes: counts -> wheel angles -> filtered wheel rates -> pose (dead reckoning) -> position on the path
 * and desired speed -> law within its limits and those of the motors -> watchdog -> commands. The order of the
 * wheels is @{ wheels | join(", ") }.
 *
{% if steering %}
 * The counter of @{ wheels[rolls] } measures how far the wheel rolls, that of @{ wheels[steers] } the steering angle:
 * its count `straight` is straight ahead. The pose is that of the axle, @{ place | join(", ") }. Within a tick the axle
 * is moved at the mean of the steering angles before and after it. The path is followed by the steered wheel, or by
 * P_l ahead of it in its direction; segments in reverse are rejected, since the body then folds onto the wheel.
 *
{% endif %}
 * Wheel rates. The resolution of a rate is 2 pi / (counts_per_turn dt) rad/s. The rate is the mean over the tick,
 * a delay of dt / 2. The filter rate += (measured - rate) dt / (smoothing + dt) has gain 1 at constant rate, a lag of
 * `smoothing` at constant acceleration, and attenuates a step of one count to dt / (smoothing + dt). For the outer
 * loop, hold, difference and filter act as a delay of dt + smoothing, which reduces the phase margin of a loop with
 * fastest pole p by about p (dt + smoothing) rad; below 0.1 rad the effect is small. Back EMF is compensated at the
 * unfiltered rate, which is dt old in the middle of the hold. With NOSLIP_MOTOR_VOLTAGE this adds about
 * e E^2 dt / R kg m^2 to the inertia of a wheel (see noslip_motor.h; R: resistance).
 *
 * The heading is kept near zero by subtracting whole turns, so that the resolution of numbers does not decrease
 * with time.
 *
 * A tick in which a wheel turned farther than possible (a misread counter) is an error and does not change pose or
 * rates. The next valid tick contains the whole distance since the last valid one, so that no distance is lost.
 *
 * Torque drives: the command is always finite and within the limits of the motors; the watchdog holds the last
 * torques over transient errors, and the command is zero in NOSLIP_WATCHDOG_STOP (for the effect see
 * noslip_motor.h). Velocity drives: the command is a wheel rate within its limits; with any error the wheels slow
 * down to zero together, with the largest acceleration. Dead reckoning continues after a stop. Only reset leaves
 * it.
 *
 * Every part is also a member that may be read, and can be used on its own: noslip_odometry.h, noslip_path.h,
 * noslip_motor.h, ...
 */
#ifndef @{ self | upper }_H
#define @{ self | upper }_H

#include "@{ own(law) }.h"
#include "@{ own(robot ~ "_dynamics") }.h"
#include "noslip_approach.h"
#include "noslip_integral.h"
#include "noslip_motor.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#include "noslip_velocity.h"
#include "noslip_watchdog.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What config describes. Every field that is not said to be optional is required: init rejects zero. */
typedef struct @{ f("config") } {
    @{ r("params") } params; /* zeros: those of @{ r("default_params") } */
    @{ real } period; /* s: time between ticks */
    @{ real } counts_per_turn[2]; /* of a wheel, with gear and quadrature; negative if the counter decreases driving forward@{ " or steering to the left" if steering } */
    int counter_bits; /* 2 to 32 */
{% if steering %}
    int straight; /* count of the steering counter straight ahead; optional */
    @{ real } steering; /* rad: largest steering angle; farther is an error, NOSLIP_RANGE */
{% endif %}
    @{ real } smoothing; /* s: time constant of the filter of wheel rates; 0: none */
    @{ real } fastest@{ each }; /* rad/s: upper bound of the rate of @{ "wheel and steering" if steering else "a wheel" } */
    @{ n("pose") } start; /* of the @{ "axle" if steering else "vehicle's point" }; optional */
    const @{ n("segment") } *segments; /* the path */
    int count; /* of segments */
{% if steering %}
    @{ n("path_options") } path; /* L is ahead of the steered wheel, in its direction; W, `ahead` and `reversing` must be 0 */
{% else %}
    @{ n("path_options") } path; /* `ahead` is that of the parameters, or 0; W must be zero (it requires a law with the suffix _offset) */
{% endif %}
    @{ real } astray; /* m: largest distance from the path; farther away is an error, NOSLIP_ASTRAY */
    @{ real } approach; /* m/s^2: largest acceleration towards the path; 0: the law's own, not bounded */
    @{ real } settling; /* s: time constant of the end of the approach; required with it */
    @{ l("gains") } gains; /* all positive */
    @{ real } ki[2]; /* integral gains of distance (1/s^3), below kp kd, and speed (1/s^2), see noslip_integral.h; optional */
    @{ real } ki_limit[2]; /* m/s^2: largest acceleration that integral action adds to each; 0: none */
    @{ r("options") } limits; /* required with NOSLIP_MOTOR_TORQUE; else 0 is what the drives can do. on_error has no effect */
    noslip_drive drive;
    @{ n("motor_settings") } motors[2]; /* of torque drives */
    @{ n("velocity_limits") } velocity[2]; /* of velocity drives */
{% if not steering %}
    @{ real } along; /* m/s^2: largest forward acceleration of velocity drives, see noslip_velocity_vehicle; with lateral, or none */
    @{ real } lateral; /* m/s^2: largest product of forward speed and yaw rate; with along, or none */
{% endif %}
    @{ real } stuck_torque@{ each }; /* N m: a wheel that does not move at a larger torque, or at half of its limit, is stuck; above that needed at a stop */
    noslip_watchdog_settings watchdog; /* zeros: stops at the first error, does not notice stuck wheels */
} @{ f("config") };

/* A time between two ticks and the quantities that depend on it. */
typedef struct @{ f("interval") } {
    @{ real } dt; /* s */
    @{ real } inverse_dt; /* 1/s */
    @{ real } max_angle@{ each }; /* rad: largest possible rotation of @{ "wheel and steering" if steering else "a wheel" } */
    @{ real } filter_gain; /* of the filter of wheel rates */
} @{ f("interval") };

{% if steering %}
/* The steered wheel as measured in the last valid tick. */
typedef struct @{ f("steering") } {
    @{ real } angle; /* rad */
    int measured; /* NOSLIP_READY: angle is at most as old as `tolerated` ticks */
    @{ real } rejected; /* s: time of tick_angles since then with impossible angles */
    @{ real } reach; /* m: how far the wheel is ahead of the axle */
    @{ real } at[2]; /* m: place of the wheel */
    @{ real } direction[2]; /* cosine and sine of its heading */
    @{ real } forward[2]; /* m/rad: its forward speed per rate of each wheel */
    @{ real } turn[2]; /* rad/rad: its yaw rate per rate of each wheel */
} @{ f("steering") };

{% endif %}
/* Complete state: initialized by init, owned by the caller, who may read it but not write to it. */
typedef struct @{ self } {
    const @{ f("config") } *config;
    @{ r("params") } params; /* these three in use now: see update */
    @{ l("gains") } gains;
    @{ r("options") } limits;
    @{ r("state") } state; /* pose, and filtered wheel rates */
    @{ real } torque[2]; /* N m: last torques from the law */
    @{ real } rate[2]; /* rad/s: unfiltered wheel rates in the last tick */
    @{ real } speed; /* m/s: forward, from the filtered rates */
    @{ l("reference") } reference;
    @{ l("config") } place; /* @{ "L and the segment that the law follows" if steering else "L only: `follow` of the law does not use the position of the segment" } */
    @{ own(law) } law, next; /* next: to check parameters before they are used */
    @{ r("dynamics") } dynamics;
    @{ n("path") } path; /* path.guide is the position on it */
    @{ n("approach") } approach;
    int approaching; /* NOSLIP_READY: it has begun */
    @{ n("integral") } integrals[2]; /* of distance and speed */
    int last; /* status of the last tick: whether integrals may grow */
    @{ n("odometry") } odometry;
{% if arm %}
    @{ real } arm[2]; /* m: of the vehicle's point ahead of the coordinates in state, and to their left */
{% endif %}
{% if steering %}
    @{ f("steering") } steering;
{% endif %}
    @{ n("encoder") } encoders[2];
    uint32_t waited; /* ticks since the last valid one */
    @{ f("interval") } nominal; /* of one period */
    @{ n("motor") } motors[2];
    @{ n("velocity") } velocity;
    noslip_watchdog watchdog;
    int ready; /* set by init */
} @{ self };

/*
 * Initializes a vehicle at rest at its start pose. `config` and its segments are not copied: the caller must keep
 * them unchanged. Errors: NOSLIP_NULL; NOSLIP_NONFINITE or NOSLIP_RANGE for the start; NOSLIP_BAD_PATH;
 * NOSLIP_SINGULAR if the law is singular; NOSLIP_BAD_PARAMETER for any other field, and if a counter could change
 * by half its range within the ticks tolerated.
 */
NOSLIP_NODISCARD int @{ f("init") }(@{ self } *self, const @{ f("config") } *config);

/*
 * Computes the commands of one tick from the counters of the encoders; `missed` is the number of ticks left out
 * before it. Commands are those of noslip_motor.h (N m, A, V or a duty), for velocity drives wheel rates (rad/s).
 * Returns NOSLIP_OK, NOSLIP_SATURATED, NOSLIP_GRIP_LIMITED, NOSLIP_WILL_SLIP or NOSLIP_ARRIVED (at every tick from
 * the end of the path on; the vehicle stops soon after), or the error of this tick. self->watchdog.state tells
 * whether the vehicle has stopped. After a stop, returns the error that caused it, or NOSLIP_NOT_READY if it was
 * not an error.
 */
int @{ f("tick") }(@{ self } *self, const uint32_t counts[2], uint32_t missed, @{ real } command[2]);

/*
{% if steering %}
 * The same from turned[@{ rolls }], the angle (rad) by which the wheel has turned in dt (s), the time since the last
 * tick, and turned[@{ steers }], the steering angle (rad) now, for
{% else %}
 * The same from the angles (rad) by which the wheels have turned in dt (s), the time since the last tick, for
{% endif %}
 * drives that report angles. dt beyond one and a half periods counts as missed ticks; NOSLIP_RANGE if it is not
 * positive or more than 1000 periods. Angles that are not possible in this time are an error, and are lost.
{% if steering %}
 * The steering angle is compared with the last valid one, until more than `tolerated` ticks in a row were errors.
{% endif %}
 */
int @{ f("tick_angles") }(@{ self } *self, const @{ real } turned[2], @{ real } dt, @{ real } command[2]);

/*
 * Changes parameters, gains and limits between two ticks; all are checked as by init, and on an error nothing
 * changes. What is held or reckoned stays. NULL: as before.@{ "" if steering else " The position of the vehicle's point ahead of the axle" }
{% if not steering %}
 * must not change (NOSLIP_BAD_PARAMETER): path and pose depend on it.
{% endif %}
 */
int @{ f("update") }(@{ self } *self, const @{ r("params") } *params, const @{ l("gains") } *gains,
    const @{ r("options") } *limits);

/* Corrects the pose, see noslip_odometry_correct; the approach and the integral of the distance begin again. */
int @{ f("correct") }(@{ self } *self, const @{ n("pose") } *truth, noslip_correction mode);

/*
 * Leaves NOSLIP_WATCHDOG_STOP, after an operator has checked the vehicle; it continues on the path where it
 * stopped. The pose is only as accurate as the counts: after many missed or misread ticks correct it.
 */
int @{ f("reset") }(@{ self } *self);

{% if steering %}
/*
 * Writes forward speed (m/s) and yaw rate (rad/s) of the axle for the last commands of velocity drives, at the steering
 * angle that they lead to within a period, to be sent as a twist.
 */
{% else %}
/* Writes forward speed (m/s) and yaw rate (rad/s) of the last commands of velocity drives, to be sent as a twist. */
{% endif %}
int @{ f("twist") }(const @{ self } *self, @{ real } twist[2]);

#ifdef __cplusplus
}
#endif

#endif
