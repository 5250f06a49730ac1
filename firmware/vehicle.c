/* vehicle.c - from encoder counts to motor commands, see vehicle.h. */
#include <stddef.h>

#include "vehicle.h"

#define UNWIND 4.0f /* rad: a little more than half a turn, so that a heading near pi stays as it is */

/* -- made before anything moves ---------------------------------------------------------------------------------------- */

/* A time of so many periods. */
static NOSLIP_COLD void set_interval(const vehicle_settings *settings, float periods, vehicle_interval *time)
{
    time->dt = settings->period * periods;
    time->per_dt = 1 / time->dt;
    time->most_turned = settings->fastest * time->dt;
    time->share = time->dt / (settings->smoothing + time->dt);
}

/* Encoders whose counters stay well within half a round in as many ticks as may be missed. */
static NOSLIP_COLD int make_encoders(vehicle *self, const vehicle_settings *settings)
{
    const float most = self->usual.most_turned * ((float)settings->watchdog.tolerated + 1);
    int i, status = NOSLIP_OK;
    for (i = 0; i < 2 && status >= 0; i++) {
        noslip_encoder_f *encoder = &self->encoders[i];
        status = noslip_encoder_init_f(encoder, settings->counts_per_turn[i], settings->counter_bits);
        if (status >= 0 && !(most < noslip_abs_f(encoder->angle) * (float)(encoder->mask >> 1))) {
            status = NOSLIP_BAD_PARAMETER;
        }
    }
    return status;
}

static NOSLIP_COLD int make_odometry(vehicle *self, const vehicle_settings *settings)
{
    noslip_odometry_options_f wheels;
    const int status =
        noslip_odometry_differential_f(&wheels, settings->params.r, settings->params.b, settings->params.d);
    return status < 0 ? status : noslip_odometry_init_f(&self->odometry, &wheels, &settings->start);
}

/* The law for all lines and arcs on which P_l lies so far ahead. */
static NOSLIP_COLD int make_law(vehicle *self, float L)
{
    const vehicle_settings *settings = self->settings;
    self->place.L = L;
    return labmate_type_iv_segment_init_f(&self->law, &settings->params, &self->place, &settings->gains, &settings->limits);
}

/* The laws of all directions in which the path is driven, to see that each can be made; last that of the first piece. */
static NOSLIP_COLD int make_laws(vehicle *self)
{
    const vehicle_settings *settings = self->settings;
    int i, status = NOSLIP_OK;
    for (i = settings->count - 1; i >= 0 && status >= 0; i--) {
        if (i == 0 || settings->segments[i].backward != settings->segments[i - 1].backward) {
            status = make_law(self, settings->way.L[settings->segments[i].backward != 0]);
        }
    }
    return status;
}

/* The law and the path have to mean the same point P_l; this law has none beside the axis. */
static NOSLIP_COLD int make_path(vehicle *self, const vehicle_settings *settings)
{
    if (noslip_abs_f(settings->way.ahead - settings->params.d) > 0 || noslip_abs_f(settings->way.W) > 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    return noslip_path_init_f(&self->path, settings->segments, settings->count, &settings->way, NULL);
}

static NOSLIP_COLD int make_motors(vehicle *self, const vehicle_settings *settings)
{
    const int status = motor_init(&self->motors[0], &settings->motors[0]);
    return status < 0 ? status : motor_init(&self->motors[1], &settings->motors[1]);
}

static void stand(vehicle *self)
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
    self->place.x_s = 0;
    self->place.y_s = 0;
    self->place.direction = 0;
    self->place.curvature = 0;
    set_interval(settings, 1, &self->usual);
    if (!noslip_is_positive_f(self->usual.per_dt) || !noslip_is_positive_f(self->usual.most_turned) || !noslip_is_positive_f(self->usual.share)) {
        return NOSLIP_BAD_PARAMETER; /* they over- or underflow */
    }
    status = watchdog_init(&self->watchdog, &settings->watchdog);
    status = status < 0 ? status : make_encoders(self, settings);
    status = status < 0 ? status : make_odometry(self, settings);
    status = status < 0 ? status : make_path(self, settings);
    status = status < 0 ? status : make_laws(self);
    status = status < 0 ? status : make_motors(self, settings);
    if (status >= 0) {
        stand(self);
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

/* Puts the encoders back to their last good counts. Where that is too long ago, goes on from these: what lies between is lost. */
static NOSLIP_COLD int misread(vehicle *self, uint32_t right, uint32_t left, uint32_t missed)
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

/* 1 if a wheel that turned so far has the last tick's torque against it and does not move. */
static int stands(const vehicle *self, int wheel, float turned)
{
    return !(turned > 0) && noslip_abs_f(self->torque[wheel]) > self->settings->stuck_torque;
}

/* Counters -> wheel rates, pose, and whether a wheel stands under a torque. */
static int sense(vehicle *self, const uint32_t counts[2], uint32_t missed, int *standing)
{
    const uint32_t right = self->encoders[0].last, left = self->encoders[1].last;
    const vehicle_interval *time = &self->usual;
    labmate_state_f *state = &self->state;
    vehicle_interval longer;
    noslip_pose_f pose; /* the odometry keeps it */
    float turned[2];
    int status;
    if ((missed | self->waited) != 0) {
        set_interval(self->settings, 1 + (float)missed + (float)self->waited, &longer);
        time = &longer;
    }
    (void)noslip_encoder_read_f(&self->encoders[0], counts[0], &turned[0]);
    (void)noslip_encoder_read_f(&self->encoders[1], counts[1], &turned[1]);
    if (!(noslip_abs_f(turned[0]) <= time->most_turned && noslip_abs_f(turned[1]) <= time->most_turned)) {
        return misread(self, right, left, missed);
    }
    *standing = stands(self, 0, noslip_abs_f(turned[0])) || stands(self, 1, noslip_abs_f(turned[1]));
    self->waited = 0;
    if (noslip_abs_f(self->odometry.pose.heading) > UNWIND) {
        unwind(self);
    }
    status = noslip_odometry_move_f(&self->odometry, turned, time->dt, &pose);
    self->rate[0] = turned[0] * time->per_dt;
    self->rate[1] = turned[1] * time->per_dt;
    state->thetadot_r += time->share * (self->rate[0] - state->thetadot_r);
    state->thetadot_l += time->share * (self->rate[1] - state->thetadot_l);
    self->speed = self->odometry.options.forward[0] * (state->thetadot_r + state->thetadot_l);
    return status;
}

/* Where on the path, and the torques there. */
static int follow(vehicle *self, float torque[2])
{
    const noslip_odometry_f *at = &self->odometry;
    const noslip_guide_f *guide = &self->path.guide;
    const int place = noslip_path_step_f(&self->path, at->pose.x, at->pose.y, at->direction, self->speed);
    int status = place;
    if (status >= 0 && noslip_abs_f(guide->L - self->place.L) > 0) { /* P_l has changed sides at a cusp */
        status = make_law(self, guide->L);
    }
    if (status >= 0) {
        self->reference.speed = guide->speed;
        self->reference.speed_rate = guide->speed_rate;
        status = labmate_type_iv_segment_follow_f(&self->law, &guide->foot, &self->state, &self->reference, torque);
    }
    return status >= 0 && place == NOSLIP_ARRIVED ? place : status;
}

/* What the motors are told for these torques. An error goes before `status`, and before NOSLIP_OK that they do not give them. */
static inline int drive(const vehicle *self, int status, const float torque[2], float command[2])
{
    const int right = motor_step(&self->motors[0], torque[0], self->rate[0], &command[0]);
    const int left = motor_step(&self->motors[1], torque[1], self->rate[1], &command[1]);
    if ((right | left) == NOSLIP_OK) {
        return status;
    }
    return right < 0 ? right : left < 0 ? left : status == NOSLIP_OK ? NOSLIP_SATURATED : status;
}

/* The command of a tick that is not good: the last good torques still, or nothing any more. */
static NOSLIP_COLD int without(vehicle *self, int status, float command[2])
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

/* The step when something is wrong with its arguments. */
static NOSLIP_COLD int refuse(const vehicle *self, const uint32_t counts[2], float command[2])
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
        return refuse(self, counts, command);
    }
    status = sense(self, counts, missed, &standing);
    if (self->watchdog.state != WATCHDOG_STOP) {
        status = status < 0 ? status : follow(self, torque);
        status = status < 0 ? status : drive(self, status, torque, command);
    }
    if (watchdog_step(&self->watchdog, status, missed, standing) != WATCHDOG_RUN) {
        return without(self, status, command);
    }
    self->torque[0] = torque[0];
    self->torque[1] = torque[1];
    return status;
}
