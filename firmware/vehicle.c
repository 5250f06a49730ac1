/* vehicle.c - from encoder counts to motor commands, see vehicle.h. */
#include <stddef.h>

#include "vehicle.h"

#define UNWIND 4.0f /* rad: slightly more than half a turn, so that a heading near pi is not unwound at every tick */

/* -- initialization ------------------------------------------------------------------------------------------------ */

/* Sets the interval of a number of periods. */
static NOSLIP_COLD void set_interval(const vehicle_settings *settings, float periods, vehicle_interval *time)
{
    time->dt = settings->period * periods;
    time->inverse_dt = 1 / time->dt;
    time->max_angle = settings->fastest * time->dt;
    time->filter_gain = time->dt / (settings->smoothing + time->dt);
}

/* Initializes the encoders; an error if a counter could change by half its range within the ticks tolerated. */
static NOSLIP_COLD int init_encoders(vehicle *self, const vehicle_settings *settings)
{
    const float max_angle = self->nominal.max_angle * ((float)settings->watchdog.tolerated + 1);
    int i, status = NOSLIP_OK;
    for (i = 0; i < 2 && status >= 0; i++) {
        noslip_encoder_f *encoder = &self->encoders[i];
        status = noslip_encoder_init_f(encoder, settings->counts_per_turn[i], settings->counter_bits);
        if (status >= 0 && !(max_angle < noslip_abs_f(encoder->angle) * (float)(encoder->mask >> 1))) {
            status = NOSLIP_BAD_PARAMETER;
        }
    }
    return status;
}

static NOSLIP_COLD int init_odometry(vehicle *self, const vehicle_settings *settings)
{
    noslip_odometry_options_f wheels;
    const int status =
        noslip_odometry_differential_f(&wheels, settings->params.r, settings->params.b, settings->params.d);
    return status < 0 ? status : noslip_odometry_init_f(&self->odometry, &wheels, &settings->start);
}

/* Initializes the law for all segments with this L. */
static NOSLIP_COLD int init_law(vehicle *self, float L)
{
    const vehicle_settings *settings = self->settings;
    self->config.L = L;
    return labmate_type_iv_segment_init_f(&self->law, &settings->params, &self->config, &settings->gains, &settings->limits);
}

/* Initializes the law for each direction of the path, to check that it is valid, and finally for the first segment. */
static NOSLIP_COLD int init_laws(vehicle *self)
{
    const vehicle_settings *settings = self->settings;
    int i, status = NOSLIP_OK;
    for (i = settings->count - 1; i >= 0 && status >= 0; i--) {
        if (i == 0 || settings->segments[i].backward != settings->segments[i - 1].backward) {
            status = init_law(self, settings->path_options.L[settings->segments[i].backward != 0]);
        }
    }
    return status;
}

/* Initializes the path; an error unless law and path use the same P_l, which is on the axis of the vehicle for this law. */
static NOSLIP_COLD int init_path(vehicle *self, const vehicle_settings *settings)
{
    if (noslip_abs_f(settings->path_options.ahead - settings->params.d) > 0 || noslip_abs_f(settings->path_options.W) > 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    return noslip_path_init_f(&self->path, settings->segments, settings->count, &settings->path_options, NULL);
}

static NOSLIP_COLD int init_motors(vehicle *self, const vehicle_settings *settings)
{
    const int status = motor_init(&self->motors[0], &settings->motors[0]);
    return status < 0 ? status : motor_init(&self->motors[1], &settings->motors[1]);
}

/* Sets the state of a vehicle at rest. */
static void set_at_rest(vehicle *self)
{
    self->state.x_c = 0;
    self->state.y_c = 0;
    self->state.phi = 0;
    self->state.theta_r = 0;
    self->state.theta_l = 0;
    self->state.thetadot_r = 0;
    self->state.thetadot_l = 0;
    self->reference.distance = 0;
    self->reference.distance_rate = 0;
    self->reference.distance_acceleration = 0;
    self->torque[0] = 0;
    self->torque[1] = 0;
    self->rate[0] = 0;
    self->rate[1] = 0;
    self->speed = 0;
    self->waited = 0;
}

int vehicle_init(vehicle *self, const vehicle_settings *settings)
{
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (settings == NULL) {
        return NOSLIP_NULL;
    }
    if (!noslip_is_positive_f(settings->period) || !noslip_limits_ok_f(&settings->smoothing, 1) || !noslip_is_positive_f(settings->fastest) ||
        !noslip_limits_ok_f(&settings->stuck_torque, 1)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->settings = settings;
    self->config.x_s = 0;
    self->config.y_s = 0;
    self->config.direction = 0;
    self->config.curvature = 0;
    set_interval(settings, 1, &self->nominal);
    if (!noslip_is_positive_f(self->nominal.inverse_dt) || !noslip_is_positive_f(self->nominal.max_angle) || !noslip_is_positive_f(self->nominal.filter_gain)) {
        return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
    }
    status = watchdog_init(&self->watchdog, &settings->watchdog);
    status = status < 0 ? status : init_encoders(self, settings);
    status = status < 0 ? status : init_odometry(self, settings);
    status = status < 0 ? status : init_path(self, settings);
    status = status < 0 ? status : init_laws(self);
    status = status < 0 ? status : init_motors(self, settings);
    if (status >= 0) {
        set_at_rest(self);
        self->ready = NOSLIP_READY;
    }
    return status;
}

int vehicle_reset(vehicle *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    return self->ready == NOSLIP_READY ? watchdog_reset(&self->watchdog) : NOSLIP_NOT_READY;
}

/* -- each tick --------------------------------------------------------------------------------------------------------- */

/* Restores the last valid counts of the encoders. If these are too old, continues from the present ones: the distance between is
 * lost. */
static NOSLIP_COLD int reject_counts(vehicle *self, uint32_t right, uint32_t left, uint32_t missed)
{
    const uint32_t tolerated = (uint32_t)self->settings->watchdog.tolerated;
    float ignored;
    if (missed >= tolerated || self->waited >= tolerated - missed) {
        self->waited = 0;
    } else {
        self->waited += missed + 1;
        (void)noslip_encoder_read_f(&self->encoders[0], right, &ignored);
        (void)noslip_encoder_read_f(&self->encoders[1], left, &ignored);
    }
    return NOSLIP_RANGE;
}

static NOSLIP_COLD void unwind(vehicle *self)
{
    (void)noslip_odometry_unwind_f(&self->odometry);
}

/* Returns 1 if a wheel did not turn although the torque of the last tick exceeds `stuck_torque`. */
static int is_stuck(const vehicle *self, int wheel, float turned)
{
    return !(turned > 0) && noslip_abs_f(self->torque[wheel]) > self->settings->stuck_torque;
}

/* Computes wheel rates and pose from the counters, and whether a wheel is stuck. */
static int measure(vehicle *self, const uint32_t counts[2], uint32_t missed, int *standing)
{
    const uint32_t right = self->encoders[0].last, left = self->encoders[1].last;
    const vehicle_interval *time = &self->nominal;
    labmate_state_f *state = &self->state;
    vehicle_interval longer;
    noslip_pose_f pose; /* also in odometry.pose */
    float turned[2];
    int status;
    if ((missed | self->waited) != 0) {
        set_interval(self->settings, 1 + (float)missed + (float)self->waited, &longer);
        time = &longer;
    }
    (void)noslip_encoder_read_f(&self->encoders[0], counts[0], &turned[0]);
    (void)noslip_encoder_read_f(&self->encoders[1], counts[1], &turned[1]);
    if (!(noslip_abs_f(turned[0]) <= time->max_angle && noslip_abs_f(turned[1]) <= time->max_angle)) {
        return reject_counts(self, right, left, missed);
    }
    *standing = is_stuck(self, 0, noslip_abs_f(turned[0])) || is_stuck(self, 1, noslip_abs_f(turned[1]));
    self->waited = 0;
    if (noslip_abs_f(self->odometry.pose.heading) > UNWIND) {
        unwind(self);
    }
    status = noslip_odometry_move_f(&self->odometry, turned, time->dt, &pose);
    self->rate[0] = turned[0] * time->inverse_dt;
    self->rate[1] = turned[1] * time->inverse_dt;
    state->thetadot_r += time->filter_gain * (self->rate[0] - state->thetadot_r);
    state->thetadot_l += time->filter_gain * (self->rate[1] - state->thetadot_l);
    self->speed = self->odometry.options.forward[0] * (state->thetadot_r + state->thetadot_l);
    return status;
}

/* Updates the position on the path and computes the torques. */
static int follow(vehicle *self, float torque[2])
{
    const noslip_odometry_f *at = &self->odometry;
    const noslip_guide_f *guide = &self->path.guide;
    const int path_status = noslip_path_step_f(&self->path, at->pose.x, at->pose.y, at->direction, self->speed);
    int status = path_status;
    if (status >= 0 && noslip_abs_f(guide->L - self->config.L) > 0) { /* P_l has changed sides at a cusp */
        status = init_law(self, guide->L);
    }
    if (status >= 0) {
        self->reference.speed = guide->speed;
        self->reference.speed_rate = guide->speed_rate;
        status = labmate_type_iv_segment_follow_f(&self->law, &guide->foot, &self->state, &self->reference, torque);
    }
    return status >= 0 && path_status == NOSLIP_ARRIVED ? path_status : status;
}

/* Computes the motor commands for these torques. Returns an error of the motors, else `status`, else NOSLIP_SATURATED if the motors
 * cannot produce the torques. */
static inline int drive(const vehicle *self, int status, const float torque[2], float command[2])
{
    const int right = motor_step(&self->motors[0], torque[0], self->rate[0], &command[0]);
    const int left = motor_step(&self->motors[1], torque[1], self->rate[1], &command[1]);
    if ((right | left) == NOSLIP_OK) {
        return status;
    }
    return right < 0 ? right : left < 0 ? left : status == NOSLIP_OK ? NOSLIP_SATURATED : status;
}

/* Computes the command of a tick with an error: the last valid torques, or zero after a stop. */
static NOSLIP_COLD int hold_or_stop(vehicle *self, int status, float command[2])
{
    if (self->watchdog.state == WATCHDOG_HOLD) {
        (void)drive(self, status, self->torque, command);
        return status;
    }
    self->torque[0] = 0;
    self->torque[1] = 0;
    command[0] = 0;
    command[1] = 0;
    return status < 0 ? status : self->watchdog.status < 0 ? self->watchdog.status : NOSLIP_NOT_READY;
}

/* Handles invalid arguments of the step. */
static NOSLIP_COLD int reject(const vehicle *self, const uint32_t counts[2], float command[2])
{
    if (command != NULL) {
        command[0] = 0;
        command[1] = 0;
    }
    return self == NULL || counts == NULL || command == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
}

int vehicle_step(vehicle *self, const uint32_t counts[2], uint32_t missed, float command[2])
{
    float torque[2] = {0, 0};
    int status, standing = 0;
    if (self == NULL || counts == NULL || command == NULL || self->ready != NOSLIP_READY) {
        return reject(self, counts, command);
    }
    status = measure(self, counts, missed, &standing);
    if (self->watchdog.state != WATCHDOG_STOP) {
        status = status < 0 ? status : follow(self, torque);
        status = status < 0 ? status : drive(self, status, torque, command);
    }
    if (watchdog_step(&self->watchdog, status, missed, standing) != WATCHDOG_RUN) {
        return hold_or_stop(self, status, command);
    }
    self->torque[0] = torque[0];
    self->torque[1] = torque[1];
    return status;
}
