{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_ekf") %}
/*
 * @{ self }.h - extended Kalman filter for the pose of @{ robot }, @{ real }
{% for line in banner %}
 * @{ line }
{% endfor %}
 *
 *     status = @{ own(robot ~ "_ekf_init") }(&ekf, &config);
 *     status = @{ own(robot ~ "_ekf_tick") }(&ekf, turned, @{ "measured, " if measured }&gyro, dt, &pose); at each tick
 *     status = @{ n("ekf_correct") }(&ekf.filter, &fix);  whenever a pose, position, heading or range comes
 *
 * The pose moves by the kinematics of the model, S(q) (9), at the heading in the middle of the tick. noslip_ekf.h
 * describes the measurements. A pose in noslip_pose is that of the point@{ place }.
 * States, in the order of filter.state:
{% for line in states %}
 *   @{ line }
{% endfor %}
 */
#ifndef @{ self | upper }_H
#define @{ self | upper }_H

#include "@{ own(robot) }.h"
#include "noslip_ekf.h"

@{ version_check }

#ifdef __cplusplus
extern "C" {
#endif

@{ config }

@{ filter }

/*
 * Initializes the filter. NOSLIP_BAD_PARAMETER: a parameter, option, noise or standard deviation is invalid; noise and
 * standard deviations must be in 1e-6 to 1e6, @{ "gyro_noise" } may also be 0. NOSLIP_NONFINITE, NOSLIP_RANGE: the start.
 */
NOSLIP_NODISCARD int @{ own(robot ~ "_ekf_init") }(@{ self } *self, const @{ self_config } *config);

/*
 * Moves the estimate by one tick and writes the estimated pose.
 * turned[@{ turned | length }]: @{ turned | join(", ") }, in this tick
{% if measured %}
 * measured[@{ measured | length }]: @{ measured | join(", ") }, in the middle of the tick
{% endif %}
 * gyro: yaw rate (rad/s), mean over the tick; NULL: there is none in this tick
 * dt: s, length of the tick, positive
 * NOSLIP_DIVERGED: the measurements disagree with the estimate, which moves on; correct it by noslip_ekf_reset.
 * On any other error nothing changes and the pose is the previous one: NOSLIP_NULL; NOSLIP_NOT_READY; NOSLIP_NONFINITE;
 * NOSLIP_BAD_PARAMETER (dt; a gyro without gyro_noise); NOSLIP_RANGE (heading: unwind and repeat; angles)@{ singular }.
{% for line in costs %}
 * @{ line }
{% endfor %}
 */
int @{ own(robot ~ "_ekf_tick") }(@{ tick });

#ifdef __cplusplus
}
#endif

#endif
