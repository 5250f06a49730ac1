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
{% if steering %}
    time->max_angle[0] = config->fastest[0] * dt;
    time->max_angle[1] = config->fastest[1] * dt;
{% else %}
    time->max_angle = config->fastest * dt;
{% endif %}
    time->filter_gain = dt / (config->smoothing + dt);
}

/* Initializes the encoders; an error if a counter could change by half its range within the ticks tolerated@{ ", or
 * at the largest steering angle" if steering }. */
static NOSLIP_COLD int init_encoders(@{ self } *self, const @{ f("config") } *config)
{
{% if steering %}
    const @{ real } most = self->nominal.max_angle[@{ rolls }] * ((@{ real })config->watchdog.tolerated + 1);
{% else %}
    const @{ real } max_angle = self->nominal.max_angle * ((@{ real })config->watchdog.tolerated + 1);
{% endif %}
    int i, status = NOSLIP_OK;
    for (i = 0; i < 2 && status >= 0; i++) {
        @{ n("encoder") } *encoder = &self->encoders[i];
{% if steering %}
        const @{ real } max_angle = i == @{ steers } ? config->steering : most;
{% endif %}
        status = @{ n("encoder_init") }(encoder, config->counts_per_turn[i], config->counter_bits);
        if (status >= 0 && !(max_angle < @{ n("abs") }(encoder->angle) * (@{ real })(encoder->mask >> 1))) {
            status = NOSLIP_BAD_PARAMETER;
        }
    }
    return status;
}

{% if steering %}
/* Returns how far the steered wheel is ahead of the axle, m. */
static @{ real } reach_of(const @{ r("params") } *params)
{
    @{ real } reach;
@{ reach }
    return reach;
}

/* Computes the distance of the axle (m/rad) and its change of heading per angle of the rolling wheel at a steering angle. */
static int axle_of(const @{ r("params") } *params, @{ real } angle, @{ real } moved[2])
{
@{ moved }
    return NOSLIP_OK;
}

/* Computes the forward speed (m/rad) and yaw rate of the steered wheel per rate of each wheel at a steering angle. */
static int motion_of(const @{ r("params") } *params, @{ real } angle, @{ real } forward[2], @{ real } turn[2])
{
@{ motion }
    return NOSLIP_OK;
}

/* Sets the options of dead reckoning, which is given distance and change of heading of the axle. */
static NOSLIP_COLD void set_axle(@{ n("odometry_options") } *wheels)
{
    wheels->forward[0] = 1;
    wheels->forward[1] = 0;
    wheels->turn[0] = 0;
    wheels->turn[1] = 1;
    wheels->ahead = 0;
    wheels->release = 0;
}

/* Places the steered wheel at a steering angle. */
static int set_steering(@{ self } *self, @{ real } angle)
{
    @{ f("steering") } *wheel = &self->steering;
    const @{ n("odometry") } *axle = &self->odometry;
    const int status = motion_of(&self->params, angle, wheel->forward, wheel->turn);
    @{ real } sine, cosine;
    @{ n("sincos") }(angle, &sine, &cosine);
    wheel->angle = angle;
    wheel->direction[0] = axle->direction[0] * cosine - axle->direction[1] * sine;
    wheel->direction[1] = axle->direction[1] * cosine + axle->direction[0] * sine;
    wheel->at[0] = axle->pose.x + wheel->reach * axle->direction[0];
    wheel->at[1] = axle->pose.y + wheel->reach * axle->direction[1];
    return status;
}

/* Initializes the steered wheel, straight ahead; an error if its forward speed changes sign up to the largest angle. */
static NOSLIP_COLD int init_steering(@{ self } *self, const @{ f("config") } *config)
{
    @{ real } forward[2], turn[2];
    int side, status;
    self->steering.reach = reach_of(&self->params);
    self->steering.measured = 0;
    self->steering.rejected = 0;
    status = set_steering(self, 0);
    for (side = -1; side <= 1 && status >= 0; side += 2) {
        status = motion_of(&self->params, (@{ real })side * config->steering, forward, turn);
        if (status >= 0 && !(forward[@{ rolls }] * self->steering.forward[@{ rolls }] > 0)) {
            status = NOSLIP_BAD_PARAMETER;
        }
    }
    return status;
}
{% else %}
/* Computes the kinematics of the wheels. */
static NOSLIP_COLD void set_wheels(const @{ r("params") } *params, @{ n("odometry_options") } *wheels)
{
@{ odometry }
    wheels->release = 0;
}
{% if arm %}

/* Computes how far the vehicle's point is ahead of its coordinates and to their left, m. */
static NOSLIP_COLD void set_arm(const @{ r("params") } *params, @{ real } arm[2])
{
@{ arm }
}
{% endif %}
{% endif %}

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

{% if steering %}
/* Takes a segment of the path as that of the law. */
static void set_segment(@{ self } *self, @{ real } x, @{ real } y, @{ real } heading, @{ real } curvature)
{
    self->place.x_s = x;
    self->place.y_s = y;
    self->place.direction = heading;
    self->place.curvature = curvature;
}

{% endif %}
/* Initializes the path; an error unless law and path use the same P_l, which is on the axis of the vehicle for this law. */
static NOSLIP_COLD int init_path(@{ self } *self, const @{ f("config") } *config)
{
    const @{ real } ahead = self->odometry.options.ahead;
    @{ n("path_options") } options;
    noslip_copy(&options, &config->path, sizeof options);
    if (@{ "options.reversing != NOSLIP_REFUSE || " if steering }@{ n("abs") }(options.W) > 0 || !(@{ n("abs") }(options.ahead) <= 0 || @{ n("abs") }(options.ahead - ahead) <= 0)) {
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
{% if steering %}
        return @{ n("velocity_init") }(&self->velocity, config->velocity, 2, config->period);
{% else %}
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
{% endif %}
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
        return @{ n("is_limit") }(config->approach) ? NOSLIP_OK : NOSLIP_BAD_PARAMETER;
    }
    if (!(2 * config->period <= config->settling)) {
        return NOSLIP_BAD_PARAMETER;
    }
    return @{ n("approach_init") }(&self->approach, config->approach, config->settling, 0);
}

/* Copies and checks parameters; the default ones if all are zero. */
static NOSLIP_COLD int set_params(@{ r("params") } *params, const @{ r("params") } *from)
{
{% if params %}
    if ({% for name in params %}{% if not loop.first %} && {% endif %}@{ n("abs") }(from->@{ name }) <= 0{% endfor %}) {
        return @{ r("default_params") }(params);
    }
{% endif %}
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
{% if steering %}
    if (!@{ n("is_positive") }(config->period) || !@{ n("is_limit") }(config->smoothing) || !@{ n("is_positive") }(config->fastest[0]) ||
        !@{ n("is_positive") }(config->fastest[1]) || !@{ n("is_positive") }(config->steering) || !@{ n("angle_ok") }(config->steering) ||
        !@{ n("limits_ok") }(config->stuck_torque, 2) || !@{ n("is_positive") }(config->astray)) {
{% else %}
    if (!@{ n("is_positive") }(config->period) || !@{ n("is_limit") }(config->smoothing) || !@{ n("is_positive") }(config->fastest) ||
        !@{ n("is_limit") }(config->stuck_torque) || !@{ n("is_positive") }(config->astray)) {
{% endif %}
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
    if (!@{ n("is_positive") }(self->nominal.inverse_dt) || @{ "!" ~ n("is_positive") ~ "(self->nominal.max_angle[0]) ||
        !" ~ n("is_positive") ~ "(self->nominal.max_angle[1])" if steering else "!" ~ n("is_positive") ~ "(self->nominal.max_angle)" } ||
        !@{ n("is_positive") }(self->nominal.filter_gain)) {
        return NOSLIP_BAD_PARAMETER; /* overflow or underflow */
    }
    @{ "set_axle(&wheels)" if steering else "set_wheels(&self->params, &wheels)" };
{% if arm %}
    set_arm(&self->params, self->arm);
{% endif %}
    status = noslip_watchdog_init(&self->watchdog, &config->watchdog);
    status = status < 0 ? status : init_encoders(self, config);
    status = status < 0 ? status : @{ n("odometry_init") }(&self->odometry, &wheels, &config->start);
{% if steering %}
    status = status < 0 ? status : init_steering(self, config);
{% endif %}
    status = status < 0 ? status : init_path(self, config);
    status = status < 0 ? status : init_drives(self, config);
    status = status < 0 ? status : init_approach(self, config);
    status = status < 0 ? status : init_integrals(self, config);
    if (status >= 0) {
{% if steering %}
        set_segment(self, config->segments[0].x, config->segments[0].y, config->segments[0].heading, config->segments[0].curvature);
{% endif %}
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
{% if not steering %}
    @{ n("odometry_options") } wheels;
{% endif %}
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
{% if steering %}
    self->steering.reach = reach_of(params);
{% else %}
    set_wheels(params, &wheels);
    if (@{ n("abs") }(wheels.ahead - self->odometry.options.ahead) > 0) {
        return NOSLIP_BAD_PARAMETER;
    }
    @{ n("write") }(wheels.forward, self->odometry.options.forward, 2);
    @{ n("write") }(wheels.turn, self->odometry.options.turn, 2);
{% if arm %}
    set_arm(params, self->arm);
{% endif %}
    if (self->config->drive == NOSLIP_DRIVE_VELOCITY && self->velocity.vehicle.along > 0) {
        @{ n("write") }(wheels.forward, self->velocity.vehicle.forward, 2);
        @{ n("write") }(wheels.turn, self->velocity.vehicle.turn, 2);
    }
{% endif %}
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
{% if steering %}
    @{ real } angle;
    int status;
{% else %}
    const @{ n("odometry_options") } *wheels;
{% endif %}
    if (self == NULL || twist == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY || self->config->drive != NOSLIP_DRIVE_VELOCITY) {
        twist[0] = 0;
        twist[1] = 0;
        return NOSLIP_NOT_READY;
    }
{% if steering %}
    angle = self->steering.angle + self->velocity.command[@{ steers }] * self->config->period;
    angle = @{ n("clip") }(angle, self->config->steering);
    status = axle_of(&self->params, angle, twist);
    twist[0] = status < 0 ? 0 : twist[0] * self->velocity.command[@{ rolls }];
    twist[1] = status < 0 ? 0 : twist[1] * self->velocity.command[@{ rolls }];
    return status;
{% else %}
    wheels = &self->odometry.options;
    twist[0] = wheels->forward[0] * self->velocity.command[0] + wheels->forward[1] * self->velocity.command[1];
    twist[1] = wheels->turn[0] * self->velocity.command[0] + wheels->turn[1] * self->velocity.command[1];
    return NOSLIP_OK;
{% endif %}
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
{% if steering %}
        self->steering.measured = 0;
{% endif %}
    } else {
        self->waited += missed + 1;
        (void)@{ n("encoder_read") }(&self->encoders[0], first, &ignored);
        (void)@{ n("encoder_read") }(&self->encoders[1], second, &ignored);
    }
    return NOSLIP_RANGE;
}

{% if steering %}
/* Keeps the last valid steering angle for as long as valid counts are kept. The encoders do not change. */
static NOSLIP_COLD int reject_angles(@{ self } *self, @{ real } dt, uint32_t missed)
{
    self->steering.rejected += dt;
    return reject_counts(self, self->encoders[0].last, self->encoders[1].last, missed);
}

{% endif %}
static NOSLIP_COLD void unwind(@{ self } *self)
{
    (void)@{ n("odometry_unwind") }(&self->odometry);
}

/* Returns 1 if a wheel did not turn although the torque of the last tick exceeds `stuck_torque`, or half of its limit. */
static int is_stuck(const @{ self } *self, int wheel, @{ real } turned)
{
    const @{ real } torque = @{ n("abs") }(self->torque[wheel]);
    return !(turned > 0) && (torque > self->config->stuck_torque@{ "[wheel]" if steering } || torque > @{ literal(0.5) } * self->law.limit[wheel]);
}

{% if steering %}
/* Returns the change of the steering angle in this tick: its share of that since the last valid one; 0 if none is. */
static @{ real } change_of(const @{ self } *self, @{ real } angle, const @{ f("interval") } *time)
{
    const @{ real } share = time->dt / (time->dt + self->steering.rejected);
    return self->steering.measured == NOSLIP_READY ? (angle - self->steering.angle) * share : 0;
}

{% endif %}
/* Updates wheel rates and pose from wheel angles that are possible in the time, and whether a wheel is stuck. */
static int move(@{ self } *self, const @{ real } turned[2], const @{ f("interval") } *time, int *standing)
{
    @{ r("state") } *state = &self->state;
    @{ n("odometry") } *odometry = &self->odometry;
    @{ n("pose") } pose; /* also in odometry.pose */
    int status;
{% if steering %}
    const @{ real } angle = turned[@{ steers }], change = change_of(self, angle, time);
    @{ real } moved[2];
    *standing = is_stuck(self, @{ rolls }, @{ n("abs") }(turned[@{ rolls }])) || is_stuck(self, @{ steers }, @{ n("abs") }(change));
{% else %}
    *standing = is_stuck(self, 0, @{ n("abs") }(turned[0])) || is_stuck(self, 1, @{ n("abs") }(turned[1]));
{% endif %}
    self->waited = 0;
    if (@{ n("abs") }(odometry->pose.heading) > UNWIND) {
        unwind(self);
    }
{% if steering %}
    status = axle_of(&self->params, angle - change / 2, moved);
    if (status < 0) {
        return status;
    }
    moved[0] *= turned[@{ rolls }];
    moved[1] *= turned[@{ rolls }];
    status = @{ n("odometry_move") }(odometry, moved, time->dt, &pose);
    self->rate[@{ rolls }] = turned[@{ rolls }] * time->inverse_dt;
    self->rate[@{ steers }] = self->steering.measured == NOSLIP_READY ? change * time->inverse_dt : state->@{ wheels[steers] };
    self->steering.measured = NOSLIP_READY;
    self->steering.rejected = 0;
{% else %}
    status = @{ n("odometry_move") }(odometry, turned, time->dt, &pose);
    self->rate[0] = turned[0] * time->inverse_dt;
    self->rate[1] = turned[1] * time->inverse_dt;
{% endif %}
    state->@{ wheels[0] } += time->filter_gain * (self->rate[0] - state->@{ wheels[0] });
    state->@{ wheels[1] } += time->filter_gain * (self->rate[1] - state->@{ wheels[1] });
{% if arm %}
    state->@{ place[0] } = pose.x - (self->arm[0] * odometry->direction[0] - self->arm[1] * odometry->direction[1]);
    state->@{ place[1] } = pose.y - (self->arm[0] * odometry->direction[1] + self->arm[1] * odometry->direction[0]);
{% else %}
    state->@{ place[0] } = pose.x;
    state->@{ place[1] } = pose.y;
{% endif %}
    state->@{ place[2] } = pose.heading;
{% if steering %}
    state->@{ angle } = angle;
    status = status < 0 ? status : set_steering(self, angle);
    self->speed = self->steering.forward[0] * state->@{ wheels[0] } + self->steering.forward[1] * state->@{ wheels[1] };
{% else %}
    self->speed = odometry->options.forward[0] * state->@{ wheels[0] } + odometry->options.forward[1] * state->@{ wheels[1] };
{% endif %}
    return status;
}

{% if steering %}
/* Returns 1 if the wheel can turn by its angle in the time, and be steered to its; 0 for NaN. */
static int is_possible(const @{ self } *self, const @{ real } turned[2], const @{ f("interval") } *time)
{
    const @{ real } angle = turned[@{ steers }];
    return @{ n("abs") }(turned[@{ rolls }]) <= time->max_angle[@{ rolls }] && @{ n("abs") }(angle) <= self->config->steering &&
           @{ n("abs") }(change_of(self, angle, time)) <= time->max_angle[@{ steers }];
}
{% else %}
/* Returns 1 if the wheels can turn by these angles in the time; 0 for NaN. */
static int is_possible(const @{ real } turned[2], const @{ f("interval") } *time)
{
    return @{ n("abs") }(turned[0]) <= time->max_angle && @{ n("abs") }(turned[1]) <= time->max_angle;
}
{% endif %}

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
{% if steering %}
    (void)@{ n("encoder_start") }(&self->encoders[@{ steers }], (uint32_t)self->config->straight, &turned[@{ steers }]);
{% endif %}
    (void)@{ n("encoder_read") }(&self->encoders[0], counts[0], &turned[0]);
    (void)@{ n("encoder_read") }(&self->encoders[1], counts[1], &turned[1]);
    return is_possible(@{ "self, " if steering }turned, time) ? move(self, turned, time, standing) : reject_counts(self, first, second, missed);
}

/* Sets the desired distance: from where the vehicle is to the path with bounded acceleration. */
static NOSLIP_BESIDE int lead(@{ self } *self, @{ real } dt)
{
    const @{ n("guide") } *guide = &self->path.guide;
    const @{ f("steering") if steering else n("odometry_options") } *wheels = &self->@{ "steering" if steering else "odometry.options" };
    @{ n("approached") } desired;
    int status = NOSLIP_OK;
    if (self->approaching != NOSLIP_READY) {
        const @{ real } turning = wheels->turn[0] * self->state.@{ wheels[0] } + wheels->turn[1] * self->state.@{ wheels[1] };
        const @{ real } rate = self->speed * guide->foot.sine + turning * @{ "guide->L" if steering else "(guide->L + wheels->ahead)" } * guide->foot.cosine;
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
{% if steering %}
    const @{ f("steering") } *wheel = &self->steering;
    const @{ n("guide") } *guide = &self->path.guide;
    const int path_status = @{ n("path_step") }(&self->path, wheel->at[0], wheel->at[1], wheel->direction, self->speed);
    int status = path_status;
    if (status >= 0 && guide->changed) {
        set_segment(self, guide->x, guide->y, guide->heading, guide->curvature);
        status = init_law(self, &self->law, guide->L, &self->params, &self->gains, &self->limits);
    }
{% else %}
    const @{ n("odometry") } *at = &self->odometry;
    const @{ n("guide") } *guide = &self->path.guide;
    const int path_status = @{ n("path_step") }(&self->path, at->pose.x, at->pose.y, at->direction, self->speed);
    int status = path_status;
    if (status >= 0 && @{ n("abs") }(guide->L - self->place.L) > 0) { /* P_l has changed sides at a cusp */
        status = init_law(self, &self->law, guide->L, &self->params, &self->gains, &self->limits);
        self->approaching = 0;
        clear_integrals(self);
    }
{% endif %}
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
        status = @{ l("step") ~ "(&self->law, " if steering else l("follow") ~ "(&self->law, &guide->foot, " }&self->state, &self->reference, torque);
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
    if (@{ n("is_positive") }(dt) && dt <= LONGEST * self->config->period) {
        const @{ real } periods = dt / self->config->period - @{ literal(0.5) };
        missed = periods > 1 ? (uint32_t)periods : 0;
        set_interval(self->config, dt, &time);
        status = is_possible(@{ "self, " if steering }turned, &time) ? move(self, turned, &time, &standing) : @{ "reject_angles(self, dt, missed)" if steering else "NOSLIP_RANGE" };
    }
    return act(self, status, missed, standing, dt, command);
}
