/*
 * ekf.c - the LABMATE's extended Kalman filter, and the learning of parameters, for EVA, in the scalar REAL with SUFFIX: arbitrary
 * bits in all arguments, constants and factors.
 *
 * Proved is that nothing undefined happens, that each call keeps a pose that is finite, with a heading in range, and places in
 * `past` within its capacity, and parameters within their bounds, so that the results hold for any sequence of calls. That the covariance is finite and positive needs
 * relations that intervals do not represent; the fuzzers check it.
 */
#include "eva.h"
#include HEADER
#include "noslip_adaptation.h"

#define TICKS 3
#define STATES 4

/*@ predicate is_pose(OF(noslip_pose) p) = \is_finite(p.x) && \is_finite(p.y) && -ANGLE_MAX <= p.heading <= ANGLE_MAX; */

static OF(noslip_ekf_past) past[TICKS];

/* Asserts the properties of a filter that is ready. */
void check_is_sound(const OF(noslip_ekf) *self)
{
    if (self->ready == NOSLIP_READY) {
        /*@ assert \is_finite(self->state[0]) && \is_finite(self->state[1]) && -ANGLE_MAX <= self->state[2] <= ANGLE_MAX; */
        /*@ assert 0 <= self->capacity <= TICKS && 0 <= self->recorded <= TICKS && self->states == STATES; */
        /*@ assert self->capacity == 0 || 0 <= self->newest < TICKS; */
    }
}

/* Any filter with these properties. */
void make_filter(OF(labmate_ekf) *self, int capacity)
{
    ANY(*self);
    ANY(past);
    self->filter.state[0] = BETWEEN(-LARGEST, LARGEST);
    self->filter.state[1] = BETWEEN(-LARGEST, LARGEST);
    self->filter.state[2] = BETWEEN(-ANGLE_MAX, ANGLE_MAX);
    self->filter.past = past;
    self->filter.capacity = capacity;
    self->filter.recorded = Frama_C_interval(0, capacity);
    self->filter.newest = Frama_C_interval(0, capacity > 0 ? capacity - 1 : 0);
    self->filter.states = STATES;
}

void check_init(int capacity)
{
    OF(labmate_ekf) self;
    OF(labmate_ekf_config) config;
    int status;
    ANY(self);
    ANY(config);
    config.filter.past = past;
    config.filter.capacity = capacity;
    status = OF(labmate_ekf_init)(&self, &config);
    if (status == NOSLIP_OK) {
        REACHED(init_good);
        /*@ assert self.filter.ready == NOSLIP_READY; */
    } else {
        REACHED(init_refused);
        /*@ assert self.filter.ready == 0; */
    }
    check_is_sound(&self.filter);
}

void check_tick(int capacity)
{
    OF(labmate_ekf) self;
    OF(noslip_pose) pose;
    REAL turned[2], gyro;
    int status;
    make_filter(&self, capacity);
    ANY(turned);
    ANY(gyro);
    ANY(pose);
    status = OF(labmate_ekf_tick)(&self, turned, any_int ? &gyro : NULL, any_real(), &pose);
    if (status >= 0) {
        REACHED(tick_good);
    } else {
        REACHED(tick_refused);
    }
    /*@ assert is_pose(pose); */
    check_is_sound(&self.filter);
}

void check_correct(int capacity)
{
    OF(labmate_ekf) self;
    OF(noslip_fix) fix;
    int status;
    make_filter(&self, capacity);
    ANY(fix);
    status = OF(noslip_ekf_correct)(&self.filter, &fix);
    if (status >= 0) {
        REACHED(correct_good);
    } else {
        REACHED(correct_refused);
    }
    check_is_sound(&self.filter);
}

void check_rest(void)
{
    OF(labmate_ekf) self;
    OF(noslip_pose) pose, sd;
    REAL covariance[9];
    int status;
    make_filter(&self, TICKS);
    ANY(pose);
    ANY(sd);
    status = OF(noslip_ekf_reset)(&self.filter, &pose, &sd);
    if (status >= 0) {
        REACHED(reset_good);
    } else {
        REACHED(reset_refused);
    }
    check_is_sound(&self.filter);
    make_filter(&self, TICKS);
    status = OF(noslip_ekf_unwind)(&self.filter);
    if (status >= 0) {
        REACHED(unwind_good);
    } else {
        REACHED(unwind_refused);
    }
    check_is_sound(&self.filter);
    make_filter(&self, TICKS);
    status = OF(noslip_ekf_pose)(&self.filter, &pose, covariance);
    if (status >= 0) {
        REACHED(pose_good);
    } else {
        REACHED(pose_refused);
    }
    /*@ assert is_pose(pose); */
}

/* Asserts the properties of an adaptation that is ready. */
void check_is_within(const OF(noslip_adaptation) *self)
{
    int i;
    for (i = 0; i < self->count; i++) {
        /*@ assert 0 <= self->estimate[i] <= 1; */
        /*@ assert \is_finite(self->used[i]); */
    }
}

void check_adaptation(int count, int rows)
{
    OF(noslip_adaptation) self;
    OF(noslip_adaptation_options) options;
    REAL start[NOSLIP_ADAPTED], regressor[NOSLIP_ADAPTED_ROWS * NOSLIP_ADAPTED], target[NOSLIP_ADAPTED_ROWS];
    int i, status;
    ANY(self);
    ANY(options);
    ANY(start);
    status = OF(noslip_adaptation_init)(&self, &options, start, count, rows);
    if (status == NOSLIP_OK) {
        REACHED(adaptation_init_good);
        /*@ assert self.ready == NOSLIP_READY && self.count == count && self.rows == rows; */
        check_is_within(&self);
    } else {
        REACHED(adaptation_init_refused);
        /*@ assert self.ready == 0; */
    }
    ANY(self);
    ANY(regressor);
    ANY(target);
    self.count = count;
    self.rows = rows;
    self.options.rate = BETWEEN(SMALLEST, LARGEST);
    for (i = 0; i < NOSLIP_ADAPTED; i++) {
        self.estimate[i] = BETWEEN(0, 1);
        self.used[i] = BETWEEN(0, 1);
    }
    status = OF(noslip_adaptation_step)(&self, regressor, target, any_real());
    if (status >= 0) {
        REACHED(adaptation_good);
    } else {
        REACHED(adaptation_refused);
    }
    check_is_within(&self);
}

int main(void)
{
    check_adaptation(1, 2);
    check_adaptation(NOSLIP_ADAPTED, NOSLIP_ADAPTED_ROWS);
    check_init(TICKS);
    check_tick(0);
    check_tick(TICKS);
    check_correct(0);
    check_correct(TICKS);
    check_rest();
    REACHED(end);
    return 0;
}
