/*
 * follower.c - the follower of a robot for EVA, in the scalar REAL with SUFFIX: whatever its parts return, commands are
 * finite and within the limits of the motors, and zero after a stop, and only the follower and the command are written.
 *
 * The parts are replaced by functions that return any status and write any bits to what the programs path.c, law.c,
 * runtime.c and drives.c prove that they write to; of law, motors and watchdog with the bounds that are proved there.
 * The follower keeps the properties in make_follower, which init establishes, so that the results hold for any
 * sequence of calls. Periods and limits of torque are specific numbers.
 */
#include "eva.h"
#include HEADER

#define OF_FOLLOWER(name) OF(GLUE(GLUE(ROBOT, _follower), name))
#define OF_ROBOT(name) OF(GLUE(ROBOT, name))
#define OF_LAW(name) OF(GLUE(LAW, name))
#define SEGMENTS 3
#define MOST 7 /* N m */

/* -- parts --------------------------------------------------------------------------------------------------------- */

static int any_init(char *part, size_t size)
{
    Frama_C_make_unknown(part, size);
    return any_int;
}

static int any_path_step(OF(noslip_path) *self, REAL x, REAL y, const REAL direction[2], REAL speed)
{
    (void)(x + y + direction[0] + direction[1] + speed);
    ANY(self->current);
    ANY(self->saved);
    ANY(self->guide);
    return any_int;
}

static int any_odometry_move(OF(noslip_odometry) *self, const REAL angle[2], REAL dt, OF(noslip_pose) *pose)
{
    (void)(angle[0] + angle[1] + dt);
    ANY(self->now);
    ANY(self->pose);
    ANY(self->direction);
    ANY(self->pending);
    ANY(self->left);
    ANY(self->steady);
    ANY(*pose);
    return any_int;
}

static int any_odometry_correct(OF(noslip_odometry) *self, const OF(noslip_pose) *truth, noslip_correction mode)
{
    OF(noslip_pose) pose;
    const REAL none[2] = {0, 0};
    return truth == NULL ? NOSLIP_NULL : any_odometry_move(self, none, (REAL)mode, &pose);
}

static int any_odometry_unwind(OF(noslip_odometry) *self)
{
    return any_odometry_correct(self, &self->pose, NOSLIP_RESET);
}

static int any_velocity_step(OF(noslip_velocity) *self, const REAL *u, const REAL *nu, int status, REAL dt,
    REAL *command)
{
    int k;
    (void)(u[0] + u[1] + nu[0] + nu[1] + dt);
    for (k = 0; k < 2; k++) {
        ANY(self->command[k]);
        ANY(command[k]);
    }
    return status < 0 ? status : any_int;
}

static int any_approach_start(OF(noslip_approach) *self, REAL distance, REAL rate, REAL speed)
{
    const int ready = self->ready;
    (void)(distance + rate + speed);
    ANY(*self);
    self->ready = ready;
    return any_int;
}

static int any_approach_step(OF(noslip_approach) *self, REAL dt, REAL speed, OF(noslip_approached) *desired)
{
    (void)dt;
    ANY(*desired);
    return any_approach_start(self, speed, speed, speed);
}

static REAL most_command; /* of the motors */

static int any_motor_step(const OF(noslip_motor) *self, REAL torque, REAL rate, REAL *command)
{
    const int failed = any_int;
    (void)(self->ready + torque + rate);
    *command = failed ? 0 : BETWEEN(-most_command, most_command);
    return failed ? Frama_C_interval(NOSLIP_NOT_READY, -1) : Frama_C_interval(NOSLIP_OK, NOSLIP_SATURATED);
}

static int any_motor_limit(const OF(noslip_motor) *self, REAL rate, REAL *torque)
{
    (void)(self->ready + rate);
    ANY(*torque);
    return any_int;
}

static noslip_watchdog_state any_watchdog_step(noslip_watchdog *self, int status, uint32_t missed, int standing)
{
    const int stopped = any_int || self->state == NOSLIP_WATCHDOG_STOP;
    (void)(missed + (uint32_t)standing);
    self->state = stopped ? NOSLIP_WATCHDOG_STOP : status < 0 ? NOSLIP_WATCHDOG_HOLD : NOSLIP_WATCHDOG_RUN;
    self->strikes = Frama_C_interval(0, self->settings.tolerated);
    self->good = Frama_C_interval(0, self->settings.forgiven);
    self->stood = Frama_C_interval(0, INT32_MAX);
    self->status = any_int;
    ANY(self->reason);
    return self->state;
}

int OF_LAW(_init)(OF(LAW) *self, const OF_ROBOT(_params) *params, const OF_LAW(_config) *config,
    const OF_LAW(_gains) *gains, const OF_ROBOT(_options) *options)
{
    (void)(params->r + config->L + gains->kv_speed + options->limit[0]);
    ANY(*self);
    return any_int;
}

int OF_LAW(_update)(OF(LAW) *self, const OF(LAW) *next)
{
    (void)next->ready;
    ANY(*self);
    return any_int;
}

int OF_LAW(_set_limits)(OF(LAW) *self, const REAL limit[2])
{
    (void)(limit[0] + limit[1]);
    ANY(self->limit);
    ANY(self->clear);
    ANY(self->held);
    return any_int;
}

int OF_LAW(_follow)(OF(LAW) *self, const OF(noslip_foot) *foot, const OF_ROBOT(_state) *state,
    const OF_LAW(_reference) *reference, REAL tau[2])
{
    (void)(foot->distance + state->x_c + reference->speed);
    ANY(self->held);
    tau[0] = BETWEEN(-MOST, MOST);
    tau[1] = BETWEEN(-MOST, MOST);
    return any_int;
}

int OF_ROBOT(_dynamics_init)(OF_ROBOT(_dynamics) *self, const OF_ROBOT(_params) *params)
{
    (void)params->r;
    ANY(*self);
    return any_int;
}

int OF_ROBOT(_dynamics_acceleration)(const OF_ROBOT(_dynamics) *self, const OF_ROBOT(_state) *state, const REAL tau[2],
    REAL qdot[5], REAL nudot[2])
{
    int k;
    (void)(self->ready + state->x_c + tau[0] + tau[1]);
    for (k = 0; k < 5; k++) {
        ANY(qdot[k]);
    }
    ANY(nudot[0]);
    ANY(nudot[1]);
    return any_int;
}

int OF(noslip_path_init)(OF(noslip_path) *self, const OF(noslip_segment) *segments, int count,
    const OF(noslip_path_options) *options, OF(noslip_path_fault) *fault)
{
    (void)(segments[count - 1].length + options->speed);
    (void)fault;
    ANY(*self);
    return any_int;
}

#define noslip_path_step any_path_step
#define noslip_path_step_f any_path_step
#define noslip_odometry_move any_odometry_move
#define noslip_odometry_move_f any_odometry_move
#define noslip_odometry_correct any_odometry_correct
#define noslip_odometry_correct_f any_odometry_correct
#define noslip_odometry_unwind any_odometry_unwind
#define noslip_odometry_unwind_f any_odometry_unwind
#define noslip_velocity_step any_velocity_step
#define noslip_velocity_step_f any_velocity_step
#define noslip_approach_start any_approach_start
#define noslip_approach_start_f any_approach_start
#define noslip_approach_step any_approach_step
#define noslip_approach_step_f any_approach_step
#define noslip_motor_step any_motor_step
#define noslip_motor_step_f any_motor_step
#define noslip_motor_limit any_motor_limit
#define noslip_motor_limit_f any_motor_limit
#define noslip_watchdog_step any_watchdog_step
#define noslip_motor_init(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_motor_init_f(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_velocity_init(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_velocity_init_f(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_velocity_set_vehicle(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_velocity_set_vehicle_f(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_odometry_init(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_odometry_init_f(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_integral_init(part, ...) any_init((char *)(part), sizeof *(part))
#define noslip_integral_init_f(part, ...) any_init((char *)(part), sizeof *(part))
#include SOURCE

/* -- checks -------------------------------------------------------------------------------------------------------- */

static OF(noslip_segment) segments[SEGMENTS];
static OF_FOLLOWER(_config) config;
static OF(GLUE(ROBOT, _follower)) self;

/* Any config of so many segments, and any follower of it, with motors whose commands are at most `most`. */
static void make_follower(noslip_drive drive, noslip_watchdog_state before, REAL most, REAL period)
{
    int k;
    most_command = most;
    ANY(segments);
    ANY(config);
    config.segments = segments;
    config.count = SEGMENTS;
    config.drive = drive;
    config.period = period;
    config.watchdog.tolerated = 3;
    config.watchdog.forgiven = 100;
    config.watchdog.stuck = Frama_C_interval(0, INT32_MAX);
    ANY(self);
    self.config = &config;
    self.ready = NOSLIP_READY;
    self.velocity.count = 2;
    self.watchdog.settings.tolerated = 3;
    self.watchdog.settings.forgiven = 100;
    self.watchdog.settings.stuck = Frama_C_interval(0, INT32_MAX);
    self.watchdog.state = before;
    self.watchdog.strikes = Frama_C_interval(0, 3);
    self.watchdog.good = Frama_C_interval(0, 100);
    self.watchdog.stood = Frama_C_interval(0, INT32_MAX);
    self.watchdog.ready = NOSLIP_READY;
    for (k = 0; k < 2; k++) {
        self.torque[k] = BETWEEN(-MOST, MOST);
    }
}

/* Asserts what every tick of torque drives leaves. */
static void check_command(int status, const REAL command[2], REAL most)
{
    int k;
    const int stopped = self.watchdog.state == NOSLIP_WATCHDOG_STOP;
    for (k = 0; k < 2; k++) {
        /*@ assert \is_finite(command[k]) && -most <= command[k] <= most; */
        /*@ assert \is_finite(self.torque[k]) && -MOST <= self.torque[k] <= MOST; */
        /*@ assert stopped ==> command[k] == 0; */
    }
    /*@ assert stopped ==> status < 0; */
    /*@ assert NOSLIP_WATCHDOG_RUN <= self.watchdog.state <= NOSLIP_WATCHDOG_STOP; */
    /*@ assert 0 <= self.watchdog.strikes <= 3; */
    /*@ assert self.config == &config && self.ready == NOSLIP_READY; */
}

static void check_tick(noslip_watchdog_state before, REAL most, REAL period)
{
    uint32_t counts[2];
    REAL turned[2], command[2];
    int status;
    make_follower(NOSLIP_DRIVE_TORQUE, before, most, period);
    counts[0] = (uint32_t)any_int;
    counts[1] = (uint32_t)any_int;
    ANY(command);
    status = OF_FOLLOWER(_tick)(&self, counts, (uint32_t)any_int, command);
    REACHED(tick);
    check_command(status, command, most);
    make_follower(NOSLIP_DRIVE_TORQUE, before, most, period);
    ANY(turned);
    ANY(command);
    status = OF_FOLLOWER(_tick_angles)(&self, turned, any_real(), command);
    REACHED(tick_angles);
    check_command(status, command, most);
}

static void check_velocity_drives(noslip_watchdog_state before, REAL period)
{
    uint32_t counts[2];
    REAL turned[2], command[2], twist[2];
    make_follower(NOSLIP_DRIVE_VELOCITY, before, LARGEST, period);
    counts[0] = (uint32_t)any_int;
    counts[1] = (uint32_t)any_int;
    (void)OF_FOLLOWER(_tick)(&self, counts, (uint32_t)any_int, command);
    ANY(turned);
    (void)OF_FOLLOWER(_tick_angles)(&self, turned, any_real(), command);
    (void)OF_FOLLOWER(_twist)(&self, twist);
    REACHED(velocity_drives);
    /*@ assert NOSLIP_WATCHDOG_RUN <= self.watchdog.state <= NOSLIP_WATCHDOG_STOP; */
    /*@ assert self.config == &config && self.ready == NOSLIP_READY; */
}

/* Between ticks, with any bits in what is given. */
static void check_changes(void)
{
    OF_ROBOT(_params) params;
    OF_LAW(_gains) gains;
    OF_ROBOT(_options) limits;
    OF(noslip_pose) truth;
    make_follower(any_int ? NOSLIP_DRIVE_TORQUE : NOSLIP_DRIVE_VELOCITY, NOSLIP_WATCHDOG_STOP, LARGEST, (REAL)0.01);
    ANY(params);
    ANY(gains);
    ANY(limits);
    ANY(truth);
    if (OF_FOLLOWER(_update)(&self, any_int ? &params : NULL, any_int ? &gains : NULL, any_int ? &limits : NULL) >= 0) {
        REACHED(update_good);
    } else {
        REACHED(update_refused);
    }
    (void)OF_FOLLOWER(_correct)(&self, &truth, any_int);
    (void)OF_FOLLOWER(_reset)(&self);
    REACHED(changes);
    /*@ assert self.config == &config && self.ready == NOSLIP_READY; */
    /*@ assert self.watchdog.state == NOSLIP_WATCHDOG_RUN; */
}

/* init with any bits in a config of so many segments: only a good one is ready. */
static void check_init(void)
{
    ANY(config);
    ANY(self);
    config.segments = segments;
    config.count = SEGMENTS;
    if (OF_FOLLOWER(_init)(&self, &config) >= 0) {
        REACHED(init_good);
        /*@ assert self.ready == NOSLIP_READY && self.config == &config; */
        /*@ assert \is_finite(config.period) && config.period > 0 && config.watchdog.tolerated >= 0; */
        /*@ assert self.torque[0] == 0 && self.torque[1] == 0 && self.watchdog.state == NOSLIP_WATCHDOG_RUN; */
    } else {
        REACHED(init_refused);
        /*@ assert self.ready == 0; */
    }
}

int main(void)
{
    noslip_watchdog_state before;
    check_init();
    check_changes();
    for (before = NOSLIP_WATCHDOG_RUN; before <= NOSLIP_WATCHDOG_STOP; before++) {
        check_velocity_drives(before, (REAL)0.01);
        check_tick(before, 20, (REAL)0.01);
        check_tick(before, LARGEST, 1000);
    }
    REACHED(end);
    return 0;
}
