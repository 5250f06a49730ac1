/*
 * whole_step.c - the controller's loop of a vehicle on a path, over recorded counts: encoders, dead reckoning, path, law.
 *
 * The run is made twice: the first time finds the steps in which a line or arc begins and those at the stop, the second calls
 * each step from changing(), standing() or, the others, ordinary(), so that they can be counted apart. With APART defined, so
 * can the parts of a step. With IMAGE defined it is firmware that reads counters, for its size.
 */
#include "labmate_type_iv_segment_f.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#include "recorded.h" /* TICKS, PERIOD, COUNTS, SPEED, DECELERATION, LEAST, recorded, start, segments */

#define ONCE __attribute__((noipa)) /* not inlined, cloned or otherwise known to its caller */
#if defined(APART)
#define PART ONCE
#else
#define PART static inline
#endif

typedef struct {
    labmate_params_f params;
    labmate_type_iv_segment_f law;
    labmate_type_iv_segment_reference_f reference;
    labmate_state_f state;
    noslip_encoder_f encoders[2];
    noslip_odometry_f odometry;
    noslip_path_f path;
} vehicle;

static vehicle self;

PART int read_encoders(const uint16_t counts[2], float turned[2])
{
    const int status = noslip_encoder_read_f(&self.encoders[0], counts[0], &turned[0]);
    return status < 0 ? status : noslip_encoder_read_f(&self.encoders[1], counts[1], &turned[1]);
}

PART int reckon(const float turned[2])
{
    noslip_pose_f pose; /* the odometry keeps it too */
    return noslip_odometry_move_f(&self.odometry, turned, PERIOD, &pose);
}

PART int look(void)
{
    const noslip_pose_f *pose = &self.odometry.pose;
    const float *forward = self.odometry.options.forward;
    return noslip_path_step_f(&self.path, pose->x, pose->y, self.odometry.direction,
                              forward[0] * self.state.thetadot_r + forward[1] * self.state.thetadot_l);
}

ONCE int make_law(void)
{
    static const labmate_type_iv_segment_gains_f gains = {1.0f, 2.5f, 2.0f};
    static const labmate_options_f limits = {.limit = {20.0f, 20.0f}, .on_limit = NOSLIP_SLOW};
    const labmate_type_iv_segment_config_f piece = {0}; /* the path tells where P_l is on which */
    return labmate_type_iv_segment_init_f(&self.law, &self.params, &piece, &gains, &limits);
}

ONCE int step(const uint16_t counts[2], float torque[2])
{
    float turned[2];
    int status = read_encoders(counts, turned);
    if (status < 0) {
        return status;
    }
    status = reckon(turned);
    if (status < 0) {
        return status;
    }
    self.state.thetadot_r = turned[0] * (1 / PERIOD);
    self.state.thetadot_l = turned[1] * (1 / PERIOD);
    status = look();
    if (status < 0) {
        return status;
    }
    self.reference.speed = self.path.guide.speed;
    self.reference.speed_rate = self.path.guide.speed_rate;
    return labmate_type_iv_segment_follow_f(&self.law, &self.path.guide.foot, &self.state, &self.reference, torque);
}

static int begin(void)
{
    noslip_path_options_f way = {.speed = SPEED, .deceleration = DECELERATION};
    noslip_odometry_options_f wheels;
    if (labmate_default_params_f(&self.params) < 0) {
        return 1;
    }
    way.ahead = self.params.d;
    return noslip_odometry_differential_f(&wheels, self.params.r, self.params.b, self.params.d) < 0 ||
           noslip_odometry_init_f(&self.odometry, &wheels, &start) < 0 ||
           noslip_encoder_init_f(&self.encoders[0], COUNTS, 16) < 0 ||
           noslip_encoder_init_f(&self.encoders[1], COUNTS, 16) < 0 ||
           make_law() < 0 || noslip_path_init_f(&self.path, segments, (int)(sizeof segments / sizeof *segments), &way, NULL) < 0;
}

#if defined(IMAGE)

/* Where a board has its encoders' counters and its motors. */
volatile uint16_t counters[2];
volatile float motors[2];

/* As firmware: for good, or until something is wrong. */
int main(void)
{
    uint16_t counts[2];
    float torque[2];
    int status = begin();
    while (status >= 0) {
        counts[0] = counters[0];
        counts[1] = counters[1];
        status = step(counts, torque);
        motors[0] = torque[0];
        motors[1] = torque[1];
    }
    return 1;
}

#else

typedef int caller(const uint16_t counts[2], float torque[2]);

static caller *callers[TICKS];

ONCE int ordinary(const uint16_t counts[2], float torque[2])
{
    const int status = step(counts, torque);
    __asm__ volatile(""); /* no sibling call: this stays the caller */
    return status;
}

ONCE int changing(const uint16_t counts[2], float torque[2])
{
    const int status = step(counts, torque);
    __asm__ volatile("");
    return status;
}

ONCE int standing(const uint16_t counts[2], float torque[2])
{
    const int status = step(counts, torque);
    __asm__ volatile("");
    return status;
}

/* 0 where all went well: every step good, every piece followed, the end near the path and near the stop. */
int main(void)
{
    const noslip_guide_f *guide = &self.path.guide;
    float torque[2];
    int i, changes = 0;
    if (begin()) {
        return 1;
    }
    for (i = 0; i < TICKS; i++) {
        if (step(recorded[i], torque) < 0) {
            return 2;
        }
        callers[i] = guide->changed ? changing : guide->waiting || guide->arrived ? standing : ordinary;
        changes += guide->changed;
    }
    if (begin()) {
        return 1;
    }
    for (i = 0; i < TICKS; i++) {
        if (callers[i](recorded[i], torque) < 0) {
            return 3;
        }
    }
    if (changes < (int)(sizeof segments / sizeof *segments) || !(noslip_abs_f(guide->foot.distance) < 0.01f) ||
        !(noslip_abs_f(guide->remaining) < 0.02f)) {
        return 4;
    }
    return 0;
}

#endif
