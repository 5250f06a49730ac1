{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro r(name) %}@{ own(robot ~ "_" ~ name) }{% endmacro %}
{% macro l(name) %}@{ own(law ~ "_" ~ name) }{% endmacro %}
{% macro f(name) %}@{ own(robot ~ "_follower_" ~ name) }{% endmacro %}
{% set self = own(robot ~ "_follower") %}
/*
 * @{ self }.c - from counts or angles of the wheels to commands, see @{ self }.h
{% for line in banner %}
 * @{ line }
{% endfor %}
 */
#include "@{ self }.h"

/* rad: slightly more than half a turn, so that a heading near pi is not unwound at every tick */
#define UNWIND @{ literal(4.0) }
#define LONGEST @{ literal(1000.0) } /* periods: longest time between two ticks that is counted */

/* -- initialization ------------------------------------------------------------------------------------------------ */

/* Sets the interval of a time (s). */
static NOSLIP_COLD void set_interval(const @{ f("config") } *config, @{ real } dt, @{ f("interval") } *time)
{
    time->dt = dt;
    time->inverse_dt = 1 / dt;
    time->max_angle = config->fastest * dt;
    time->filter_gain = dt / (config->smoothing + dt);
}

/* Initializes the encoders; an error if a counter could change by half its range within the ticks tolerated. */
static NOSLIP_COLD int init_encoders(@{ self } *self, const @{ f("config") } *config)
{
    const @{ real } max_angle = self->nominal.max_angle * ((@{ real })config->watchdog.tolerated + 1);
    int i, status = NOSLIP_OK;
    for (i = 0; i < 2 && status >= 0; i++) {
        @{ n("encoder") } *encoder = &self->encoders[i];
        status = @{ n("encoder_init") }(encoder, config->counts_per_turn[i], config->counter_bits);
        if (status >= 0 && !(max_angle < @{ n("abs") }(encoder->angle) * (@{ real })(encoder->mask >> 1))) {
            status = NOSLIP_BAD_PARAMETER;
        }
    }
    return status;
}

/* Computes the kinematics of the wheels. */
static NOSLIP_COLD void set_wheels(const @{ r("params") } *params, @{ n("odometry_options") } *wheels)
{
@{ odometry }
    wheels->release = 0;
}

/* Checks the options and initializes a law for a P_l with this L. */
static NOSLIP_COLD int init_law(@{ self } *self, @{ own(law) } *law, @{ real } L, const @{ r("params") } *params,
    const @{ l("gains") } *gains, const @{ r("options") } *limits)
{
    const int bounded = self->config->drive != NOSLIP_DRIVE_TORQUE || ((limits->limit[0] > 0 || self->motors[0].mode != NOSLIP_MOTOR_TORQUE) &&
        (limits->limit[1] > 0 || self->motors[1].mode != NOSLIP_MOTOR_TORQUE));
    const @{ real } most = gains->kp_distance * gains->kd_distance; /* Routh */
    if (!bounded{% for gain in gains %} || !(gains->@{ gain } > 0){% endfor %} || !(self->config->ki[0] < most)) {
        return NOSLIP_BAD_PARAMETER;
    }
    self->place.L = L;
    return @{ l("init") }(law, params, &self->place, gains, limits);
}

/* Initializes `next` for each direction of the path, to check that it is valid, and finally with the present L. */
static NOSLIP_COLD int init_laws(@{ self } *self, const @{ r("params") } *params, const @{ l("gains") } *gains,
    const @{ r("options") } *limits)
{
    const @{ f("config") } *config = self->config;
    const @{ real } L = self->place.L;
    int i, status = NOSLIP_OK;
    for (i = config->count - 1; i >= 0 && status >= 0; i--) {
        if (i == 0 || config->segments[i].backward != config->segments[i - 1].backward) {
            status = init_law(self, &self->next, config->path.L[config->segments[i].backward != 0], params, gains, limits);
        }
    }
    self->place.L = L;
    return status < 0 ? status : init_law(self, &self->next, L, params, gains, limits);
}

/* Initializes the path; an error unless law and path use the same P_l, which is on the axis of the vehicle for this law. */
static NOSLIP_COLD int init_path(@{ self } *self, const @{ f("config") } *config)
{
    const @{ real } ahead = self->odometry.options.ahead;
    @{ n("path_options") } options;
    noslip_copy(&options, &config->path, sizeof options);
    if (@{ n("abs") }(options.W) > 0 || !(@{ n("abs") }(options.ahead) <= 0 || @{ n("abs") }(options.ahead - ahead) <= 0)) {
        return NOSLIP_BAD_PARAMETER;
    }
    options.ahead = ahead;
    return @{ n("path_init") }(&self->path, config->segments, config->count, &options, NULL);
}

/* Initializes motors or velocity commands. */
static NOSLIP_COLD int init_drives(@{ self } *self, const @{ f("config") } *config)
{
    int i, status = NOSLIP_OK;
    if (config->drive == NOSLIP_DRIVE_VELOCITY) {
        const @{ real } most[2] = {config->along, config->lateral};
        @{ n("velocity_vehicle") } vehicle;
        status = @{ n("velocity_init") }(&self->velocity, config->velocity, 2, config->period);
        if (status < 0 || (@{ n("abs") }(most[0]) <= 0 && @{ n("abs") }(most[1]) <= 0)) {
            return status;
        }
        @{ n("write") }(self->odometry.options.forward, vehicle.forward, 2);
        @{ n("write") }(self->odometry.options.turn, vehicle.turn, 2);
        vehicle.along = most[0];
        vehicle.lateral = most[1];
        return @{ n("velocity_set_vehicle") }(&self->velocity, &vehicle);
    }
    for (i = 0; i < 2 && status >= 0; i++) {
        status = @{ n("motor_init") }(&self->motors[i], &config->motors[i]);
    }
    return config->drive == NOSLIP_DRIVE_TORQUE ? status : NOSLIP_BAD_PARAMETER;
}

/* Initializes integral action, of distance and speed. */
static NOSLIP_COLD int init_integrals(@{ self } *self, const @{ f("config") } *config)
{
    int i, status = NOSLIP_OK;
    for (i = 0; i < 2 && status >= 0; i++) {
        status = @{ n("integral_init") }(&self->integrals[i], config->ki[i], config->ki_limit[i]);
    }
    return status;
}

static NOSLIP_COLD int init_approach(@{ self } *self, const @{ f("config") } *config)
{
    self->approaching = 0;
    if (!(config->approach > 0)) {
        self->approach.ready = 0;
        return @{ n("limits_ok") }(&config->approach, 1) ? NOSLIP_OK : NOSLIP_BAD_PARAMETER;
    }
    if (!(2 * config->period <= config->settling)) {
        return NOSLIP_BAD_PARAMETER;
    }
    return @{ n("approach_init") }(&self->approach, config->approach, config->settling, 0);
}

/* Copies and checks parameters; the default ones if all are zero. */
static NOSLIP_COLD int set_params(@{ r("params") } *params, const @{ r("params") } *from)
{
    if ({% for name in params %}{% if not loop.first %} && {% endif %}@{ n("abs") }(from->@{ name }) <= 0{% endfor %}) {
        return @{ r("default_params") }(params);
    }
    noslip_copy(params, from, sizeof *params);
    return @{ r("check_params") }(params);
}

/* Begins integral action again. */
static NOSLIP_COLD void clear_integrals(@{ self } *self)
{
    (void)@{ n("integral_reset") }(&self->integrals[0], 0);
    (void)@{ n("integral_reset") }(&self->integrals[1], 0);
}

/* Sets the state of a vehicle at rest. */
static void set_at_rest(@{ self } *self)
{
{% for name in state %}
    self->state.@{ name } = 0;
{% endfor %}
    self->reference.distance = 0;
    self->reference.distance_rate = 0;
    self->reference.distance_acceleration = 0;
    self->torque[0] = 0;
    self->torque[1] = 0;
    self->rate[0] = 0;
    self->rate[1] = 0;
    self->speed = 0;
    self->waited = 0;
    self->last = NOSLIP_OK;
}

int @{ f("init") }(@{ self } *self, const @{ f("config") } *config)
{
    @{ n("odometry_options") } wheels;
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (config == NULL) {
        return NOSLIP_NULL;
    }
    if (!@{ n("is_positive") }(config->period) || !@{ n("limits_ok") }(&config->smoothing, 1) || !@{ n("is_positive") }(config->fastest) ||
        !@{ n("limits_ok") }(&config->stuck_torque, 1) || !@{ n("is_positive") }(config->astray)) {
        return NOSLIP_BAD_PARAMETER;
    }
    status = set_params(&self->params, &config->params);
    if (status < 0) {
        return status;
    }
    self->config = config;
    self->place.L = config->path.L[0];
    self->place.x_s = 0;
    self->place.y_s = 0;
    self->place.direction = 0;
    self->place.curvature = 0;
    set_interval(config, config->period, &self->nominal);
    if (!@{ n("is_positive") }(self->nominal.inverse_dt) || !@{ n("is_positive") }(self->nominal.max_angle) ||
        !@{ n("is_positive") }(self->nominal.filter_gain)) {
        return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
    }
    set_wheels(&self->params, &wheels);
    status = noslip_watchdog_init(&self->watchdog, &config->watchdog);
    status = status < 0 ? status : init_encoders(self, config);
    status = status < 0 ? status : @{ n("odometry_init") }(&self->odometry, &wheels, &config->start);
    status = status < 0 ? status : init_path(self, config);
    status = status < 0 ? status : init_drives(self, config);
    status = status < 0 ? status : init_approach(self, config);
    status = status < 0 ? status : init_integrals(self, config);
    if (status >= 0) {
        self->place.L = config->path.L[config->segments[0].backward != 0];
        status = init_laws(self, &self->params, &config->gains, &config->limits);
    }
    status = status < 0 ? status : @{ r("dynamics_init") }(&self->dynamics, &self->params);
    if (status >= 0) {
        noslip_copy(&self->law, &self->next, sizeof self->law);
        noslip_copy(&self->gains, &config->gains, sizeof self->gains);
        noslip_copy(&self->limits, &config->limits, sizeof self->limits);
        set_at_rest(self);
        self->ready = NOSLIP_READY;
    }
    return status;
}

/* -- between ticks ------------------------------------------------------------------------------------------------- */

int @{ f("update") }(@{ self } *self, const @{ r("params") } *params, const @{ l("gains") } *gains,
    const @{ r("options") } *limits)
{
    @{ n("odometry_options") } wheels;
    @{ r("dynamics") } dynamics;
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    params = params != NULL ? params : &self->params;
    gains = gains != NULL ? gains : &self->gains;
    limits = limits != NULL ? limits : &self->limits;
    status = init_laws(self, params, gains, limits);
    status = status < 0 ? status : @{ r("dynamics_init") }(&dynamics, params);
    if (status < 0) {
        return status;
    }
    set_wheels(params, &wheels);
    if (@{ n("abs") }(wheels.ahead - self->odometry.options.ahead) > 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    @{ n("write") }(wheels.forward, self->odometry.options.forward, 2);
    @{ n("write") }(wheels.turn, self->odometry.options.turn, 2);
    if (self->config->drive == NOSLIP_DRIVE_VELOCITY && self->velocity.vehicle.along > 0) {
        @{ n("write") }(wheels.forward, self->velocity.vehicle.forward, 2);
        @{ n("write") }(wheels.turn, self->velocity.vehicle.turn, 2);
    }
    noslip_copy(&self->dynamics, &dynamics, sizeof dynamics);
    noslip_copy(&self->params, params, sizeof self->params);
    noslip_copy(&self->gains, gains, sizeof self->gains);
    noslip_copy(&self->limits, limits, sizeof self->limits);
    return @{ l("update") }(&self->law, &self->next);
}

int @{ f("correct") }(@{ self } *self, const @{ n("pose") } *truth, noslip_correction mode)
{
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    status = @{ n("odometry_correct") }(&self->odometry, truth, mode);
    if (status >= 0) {
        self->approaching = 0;
        clear_integrals(self);
    }
    return status;
}

int @{ f("reset") }(@{ self } *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    self->approaching = 0;
    clear_integrals(self);
    if (self->config->drive == NOSLIP_DRIVE_VELOCITY) {
        (void)@{ n("velocity_reset") }(&self->velocity, self->rate);
    }
    return noslip_watchdog_reset(&self->watchdog);
}

int @{ f("twist") }(const @{ self } *self, @{ real } twist[2])
{
    const @{ n("odometry_options") } *wheels;
    if (self == NULL || twist == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY || self->config->drive != NOSLIP_DRIVE_VELOCITY) {
        twist[0] = 0;
        twist[1] = 0;
        return NOSLIP_NOT_READY;
    }
    wheels = &self->odometry.options;
    twist[0] = wheels->forward[0] * self->velocity.command[0] + wheels->forward[1] * self->velocity.command[1];
    twist[1] = wheels->turn[0] * self->velocity.command[0] + wheels->turn[1] * self->velocity.command[1];
    return NOSLIP_OK;
}

/* -- each tick ----------------------------------------------------------------------------------------------------- */

/* Restores the last valid counts of the encoders. If these are too old, continues from the present ones: the distance
 * between is lost. */
static NOSLIP_COLD int reject_counts(@{ self } *self, uint32_t first, uint32_t second, uint32_t missed)
{
    const uint32_t tolerated = (uint32_t)self->config->watchdog.tolerated;
    @{ real } ignored;
    if (missed >= tolerated || self->waited >= tolerated - missed) {
        self->waited = 0;
    } else {
        self->waited += missed + 1;
        (void)@{ n("encoder_read") }(&self->encoders[0], first, &ignored);
        (void)@{ n("encoder_read") }(&self->encoders[1], second, &ignored);
    }
    return NOSLIP_RANGE;
}

static NOSLIP_COLD void unwind(@{ self } *self)
{
    (void)@{ n("odometry_unwind") }(&self->odometry);
}

/* Returns 1 if a wheel did not turn although the torque of the last tick exceeds `stuck_torque`, or half of its limit. */
static int is_stuck(const @{ self } *self, int wheel, @{ real } turned)
{
    const @{ real } torque = @{ n("abs") }(self->torque[wheel]);
    return !(turned > 0) && (torque > self->config->stuck_torque || torque > @{ literal(0.5) } * self->law.limit[wheel]);
}

/* Updates wheel rates and pose from wheel angles that are possible in the time, and whether a wheel is stuck. */
static int move(@{ self } *self, const @{ real } turned[2], const @{ f("interval") } *time, int *standing)
{
    @{ r("state") } *state = &self->state;
    @{ n("odometry") } *odometry = &self->odometry;
    @{ n("pose") } pose; /* also in odometry.pose */
    int status;
    *standing = is_stuck(self, 0, @{ n("abs") }(turned[0])) || is_stuck(self, 1, @{ n("abs") }(turned[1]));
    self->waited = 0;
    if (@{ n("abs") }(odometry->pose.heading) > UNWIND) {
        unwind(self);
    }
    status = @{ n("odometry_move") }(odometry, turned, time->dt, &pose);
    self->rate[0] = turned[0] * time->inverse_dt;
    self->rate[1] = turned[1] * time->inverse_dt;
    state->@{ wheels[0] } += time->filter_gain * (self->rate[0] - state->@{ wheels[0] });
    state->@{ wheels[1] } += time->filter_gain * (self->rate[1] - state->@{ wheels[1] });
    state->@{ place[0] } = pose.x;
    state->@{ place[1] } = pose.y;
    state->@{ place[2] } = pose.heading;
    self->speed = odometry->options.forward[0] * state->@{ wheels[0] } + odometry->options.forward[1] * state->@{ wheels[1] };
    return status;
}

/* Returns 1 if the wheels can turn by these angles in the time; 0 for NaN. */
static int is_possible(const @{ real } turned[2], const @{ f("interval") } *time)
{
    return @{ n("abs") }(turned[0]) <= time->max_angle && @{ n("abs") }(turned[1]) <= time->max_angle;
}

/* Updates wheel rates and pose from the counters. */
static NOSLIP_BESIDE int measure(@{ self } *self, const uint32_t counts[2], uint32_t missed, int *standing)
{
    const uint32_t first = self->encoders[0].last, second = self->encoders[1].last;
    const @{ f("interval") } *time = &self->nominal;
    @{ f("interval") } longer;
    @{ real } turned[2];
    if ((missed | self->waited) != 0) {
        set_interval(self->config, self->config->period * (1 + (@{ real })missed + (@{ real })self->waited), &longer);
        time = &longer;
    }
    (void)@{ n("encoder_read") }(&self->encoders[0], counts[0], &turned[0]);
    (void)@{ n("encoder_read") }(&self->encoders[1], counts[1], &turned[1]);
    return is_possible(turned, time) ? move(self, turned, time, standing) : reject_counts(self, first, second, missed);
}

/* Sets the desired distance: from where the vehicle is to the path with bounded acceleration. */
static NOSLIP_BESIDE int lead(@{ self } *self, @{ real } dt)
{
    const @{ n("guide") } *guide = &self->path.guide;
    const @{ n("odometry_options") } *wheels = &self->odometry.options;
    @{ n("approached") } desired;
    int status = NOSLIP_OK;
    if (self->approaching != NOSLIP_READY) {
        const @{ real } turning = wheels->turn[0] * self->state.@{ wheels[0] } + wheels->turn[1] * self->state.@{ wheels[1] };
        const @{ real } rate = self->speed * guide->foot.sine + turning * (guide->L + wheels->ahead) * guide->foot.cosine;
        status = @{ n("approach_start") }(&self->approach, guide->foot.distance, rate, self->speed);
        self->approaching = status < 0 ? 0 : NOSLIP_READY;
        dt = 0;
    }
    dt = dt < self->config->settling ? dt : self->config->settling;
    status = status < 0 ? status : @{ n("approach_step") }(&self->approach, dt, guide->speed, &desired);
    if (status >= 0) {
        self->reference.distance = desired.distance;
        self->reference.distance_rate = desired.distance_rate;
        self->reference.distance_acceleration = desired.distance_acceleration;
    }
    return status;
}

/* Adds integral action to the desired accelerations of distance and speed. */
static NOSLIP_BESIDE int integrate(@{ self } *self, @{ real } dt)
{
    const @{ n("guide") } *guide = &self->path.guide;
    @{ real } added;
    int status = @{ n("integral_step") }(&self->integrals[0], self->reference.distance - guide->foot.distance, dt, self->last, &added);
    if (status >= 0) {
        self->reference.distance_acceleration = (self->approach.ready == NOSLIP_READY ? self->approach.desired.distance_acceleration : 0) + added;
        status = @{ n("integral_step") }(&self->integrals[1], guide->speed - self->speed, dt, self->last, &added);
        self->reference.speed_rate = guide->speed_rate + added;
    }
    return status;
}

/* Gives the law the torques that the motors have at the present rates as limits. */
static int limit(@{ self } *self)
{
    @{ real } most[2];
    int i, status = NOSLIP_OK;
    if (self->motors[0].mode == NOSLIP_MOTOR_TORQUE && self->motors[1].mode == NOSLIP_MOTOR_TORQUE) {
        return NOSLIP_OK;
    }
    for (i = 0; i < 2 && status >= 0; i++) {
        status = @{ n("motor_limit") }(&self->motors[i], self->rate[i], &most[i]);
        most[i] = self->limits.limit[i] > 0 && self->limits.limit[i] < most[i] ? self->limits.limit[i] : most[i];
    }
    return status < 0 ? status : @{ l("set_limits") }(&self->law, most);
}

/* Updates the position on the path and computes the torques. */
static int follow(@{ self } *self, @{ real } dt, @{ real } torque[2])
{
    const @{ n("odometry") } *at = &self->odometry;
    const @{ n("guide") } *guide = &self->path.guide;
    const int path_status = @{ n("path_step") }(&self->path, at->pose.x, at->pose.y, at->direction, self->speed);
    int status = path_status;
    if (status >= 0 && @{ n("abs") }(guide->L - self->place.L) > 0) { /* P_l has changed sides at a cusp */
        status = init_law(self, &self->law, guide->L, &self->params, &self->gains, &self->limits);
        self->approaching = 0;
        clear_integrals(self);
    }
    if (status >= 0 && !(@{ n("abs") }(guide->foot.distance) <= self->config->astray)) {
        status = NOSLIP_ASTRAY;
    }
    if (status >= 0 && self->approach.ready == NOSLIP_READY) {
        status = lead(self, dt);
    }
    if (status >= 0 && self->config->drive == NOSLIP_DRIVE_TORQUE) {
        status = limit(self);
    }
    if (status >= 0) {
        self->reference.speed = guide->speed;
        self->reference.speed_rate = guide->speed_rate;
        if (self->config->ki[0] > 0 || self->config->ki[1] > 0) {
            status = integrate(self, dt);
        }
    }
    if (status >= 0) {
        status = @{ l("follow") }(&self->law, &guide->foot, &self->state, &self->reference, torque);
        self->last = status;
    }
    return status >= 0 && path_status == NOSLIP_ARRIVED ? path_status : status;
}

/* Computes the motor commands for these torques. Returns an error of the motors, else `status`, else NOSLIP_SATURATED
 * if the motors cannot produce the torques. */
static inline int drive(const @{ self } *self, int status, const @{ real } torque[2], @{ real } command[2])
{
    const int first = @{ n("motor_step") }(&self->motors[0], torque[0], self->rate[0], &command[0]);
    const int second = @{ n("motor_step") }(&self->motors[1], torque[1], self->rate[1], &command[1]);
    if ((first | second) == NOSLIP_OK) {
        return status;
    }
    return first < 0 ? first : second < 0 ? second : status == NOSLIP_OK ? NOSLIP_SATURATED : status;
}

/* Computes the wheel rates to which these torques lead; with an error in `status` the wheels slow down to zero
 * together. */
static NOSLIP_BESIDE int roll(@{ self } *self, int status, const @{ real } torque[2], @{ real } dt, @{ real } command[2])
{
    @{ real } qdot[@{ coordinates }], u[2];
    u[0] = 0;
    u[1] = 0;
    if (status >= 0) {
        const int caused = @{ r("dynamics_acceleration") }(&self->dynamics, &self->state, torque, qdot, u);
        status = caused < 0 ? caused : status;
    }
    dt = dt < 2 * self->config->period ? dt : self->config->period;
    return @{ n("velocity_step") }(&self->velocity, u, self->rate, status, dt, command);
}

/* Computes the command of a tick with an error: the last valid torques, or zero after a stop. */
static NOSLIP_COLD int hold_or_stop(@{ self } *self, int status, @{ real } command[2])
{
    const int held = self->watchdog.state == NOSLIP_WATCHDOG_HOLD;
    if (!held) {
        self->torque[0] = 0;
        self->torque[1] = 0;
        status = status < 0 ? status : self->watchdog.status < 0 ? self->watchdog.status : NOSLIP_NOT_READY;
    }
    if (self->config->drive == NOSLIP_DRIVE_VELOCITY) { /* `roll` has written the command */
        return status;
    }
    if (held) {
        (void)drive(self, status, self->torque, command);
    } else {
        command[0] = 0;
        command[1] = 0;
    }
    return status;
}

/* Computes the command after the measurement of a tick, which took dt. */
static int act(@{ self } *self, int status, uint32_t missed, int standing, @{ real } dt, @{ real } command[2])
{
    const int stopped = self->watchdog.state == NOSLIP_WATCHDOG_STOP;
    @{ real } torque[2];
    torque[0] = 0;
    torque[1] = 0;
    if (!stopped) {
        status = status < 0 ? status : follow(self, dt, torque);
    }
    if (self->config->drive == NOSLIP_DRIVE_VELOCITY) {
        const int made = roll(self, stopped ? NOSLIP_NOT_READY : status, torque, dt, command);
        status = stopped ? status : made;
    } else if (!stopped) {
        status = status < 0 ? status : drive(self, status, torque, command);
    }
    if (noslip_watchdog_step(&self->watchdog, status, missed, standing) != NOSLIP_WATCHDOG_RUN) {
        return hold_or_stop(self, status, command);
    }
    self->torque[0] = torque[0];
    self->torque[1] = torque[1];
    return status;
}

/* Handles invalid arguments of a tick. */
static NOSLIP_COLD int reject(const @{ self } *self, const void *given, @{ real } command[2])
{
    if (command != NULL) {
        command[0] = 0;
        command[1] = 0;
    }
    return self == NULL || given == NULL || command == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
}

int @{ f("tick") }(@{ self } *self, const uint32_t counts[2], uint32_t missed, @{ real } command[2])
{
    int status, standing = 0;
    if (self == NULL || counts == NULL || command == NULL || self->ready != NOSLIP_READY) {
        return reject(self, counts, command);
    }
    status = measure(self, counts, missed, &standing);
    return act(self, status, missed, standing, self->config->period * (1 + (@{ real })missed), command);
}

int @{ f("tick_angles") }(@{ self } *self, const @{ real } turned[2], @{ real } dt, @{ real } command[2])
{
    @{ f("interval") } time;
    uint32_t missed = 0;
    int status = NOSLIP_RANGE, standing = 0;
    if (self == NULL || turned == NULL || command == NULL || self->ready != NOSLIP_READY) {
        return reject(self, turned, command);
    }
    if (dt > 0 && dt <= LONGEST * self->config->period) { /* false for NaN */
        const @{ real } periods = dt / self->config->period - @{ literal(0.5) };
        missed = periods > 1 ? (uint32_t)periods : 0;
        set_interval(self->config, dt, &time);
        status = is_possible(turned, &time) ? move(self, turned, &time, &standing) : NOSLIP_RANGE;
    }
    return act(self, status, missed, standing, dt, command);
}
