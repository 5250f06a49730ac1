/*
 * route.h - a vehicle on a path: encoders, dead reckoning with a correction, the path, integral action, and the other inline functions
 * of the headers, compiled with the flags and in the C dialect of the file that includes this one.
 *
 * REAL must be defined as the scalar and OF(name) as the name of a runtime function for it. Each tick adds the bits of every output
 * to a digest, which is compared with the one from the computer that generated the self-test.
 */
#ifndef ROUTE_H
#define ROUTE_H

#include "noslip_angle.h"
#include "noslip_integral.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#include "noslip_reversing.h"
#include "noslip_solve.h"

#define ROUTE_TICKS 400u /* the vehicle arrives after about 330 */
#define ROUTE_PERIOD ((REAL)0.01)

typedef struct {
    OF(noslip_encoder) encoders[2];
    OF(noslip_odometry) odometry;
    OF(noslip_path) path;
    OF(noslip_integral) integral;
    uint32_t counters[2], seed, digest;
    int status, which;
} route;

static const OF(noslip_segment) route_segments[] = {{0, 0, 0, 0, 1, 0}, {1, 0, 0, 1, (REAL)1.5, 0}, {2, 1, (REAL)1.5, 0, 1, 0}};

/* Adds 32 bits to a digest (FNV-1a, by words). */
static uint32_t digest_word(uint32_t digest, uint32_t word)
{
    return (digest ^ word) * 16777619u;
}

/* Adds the bits of `count` numbers. */
static uint32_t digest_reals(uint32_t digest, const REAL *values, unsigned count)
{
    unsigned i, k;
    for (i = 0; i < count; i++) {
        union {
            REAL value;
            uint32_t words[sizeof(REAL) / sizeof(uint32_t)];
        } number;
        number.value = values[i];
        for (k = 0; k < sizeof(REAL) / sizeof(uint32_t); k++) {
            digest = digest_word(digest, number.words[k]);
        }
    }
    return digest;
}

static void route_begin(route *self)
{
    OF(noslip_odometry_options) options;
    OF(noslip_path_options) along = {0, 0, 0, 0, 0, {0, 0}, 0, 0, NOSLIP_REFUSE, NOSLIP_STOP_POINT, 0};
    int status = OF(noslip_odometry_differential)(&options, (REAL)0.1, (REAL)0.25, (REAL)0.05);
    options.release = (REAL)0.3;
    along.speed = 1;
    along.deceleration = (REAL)0.5;
    along.L[0] = (REAL)0.3;
    along.W = (REAL)0.02;
    along.gap = 1; /* the last line does not begin where the arc ends */
    along.kink = (REAL)0.1;
    status += OF(noslip_odometry_init)(&self->odometry, &options, NULL);
    status += OF(noslip_encoder_init)(&self->encoders[0], 4096, 16);
    status += OF(noslip_encoder_init)(&self->encoders[1], 4096, 16);
    status += OF(noslip_path_init)(&self->path, route_segments, 3, &along, NULL);
    status += OF(noslip_integral_init)(&self->integral, (REAL)0.8, (REAL)0.05);
    self->counters[0] = self->counters[1] = 0;
    self->seed = 1992;
    self->which = 0;
    self->status = NOSLIP_OK;
    self->digest = digest_word(2166136261u, (uint32_t)status);
}

/* Functions of the runtime that have no state, evaluated at a pose. */
static void route_numbers(route *self, const OF(noslip_pose) *pose)
{
    REAL found[6], matrix[9];
    int order[3], i, status;
    OF(noslip_sincos)(7 * pose->heading, &found[0], &found[1]);
    found[2] = OF(noslip_sinc)(pose->heading);
    found[3] = OF(noslip_atan2)(pose->y, pose->x);
    status = OF(noslip_nearest_angle)(pose->heading + 20, pose->y, &found[4]);
    for (i = 0; i < 9; i++) {
        matrix[i] = i % 4 == 0 ? 3 + pose->x : found[i % 3];
    }
    found[5] = OF(noslip_invert)(matrix, order, 3);
    self->digest = digest_word(digest_reals(digest_reals(self->digest, found, 6), matrix, 9), (uint32_t)status);
    for (i = 0; i < 9; i++) {
        matrix[i] = i % 4 == 0 ? 3 + pose->x : found[i % 3];
    }
    status = OF(noslip_ldl)(matrix, 3);
    OF(noslip_ldl_solve)(matrix, found, 3);
    self->digest = digest_word(digest_reals(self->digest, found, 3), (uint32_t)status);
}

/* Simulates one tick; `tick` counts from 0. */
static void route_tick(route *self, unsigned tick)
{
    static const REAL lookaheads[2] = {(REAL)0.35, (REAL)-0.25};
    OF(noslip_pose) pose = {0, 0, 0};
    OF(noslip_guide) seen;
    REAL turned[2] = {0, 0}, added = 0, speed;
    int status;
    self->seed = self->seed * 1664525u + 1013904223u;
    self->counters[0] += 62u + (self->seed >> 29) + (tick > 100u && tick < 250u ? 32u : 0u) + (tick == 300u ? 1600u : 0u);
    self->counters[1] += 62u + (self->seed >> 28 & 7u);
    status = OF(noslip_encoder_read)(&self->encoders[0], self->counters[0], &turned[0]);
    status += OF(noslip_encoder_read)(&self->encoders[1], self->counters[1], &turned[1]);
    status += OF(noslip_odometry_move)(&self->odometry, turned, ROUTE_PERIOD, &pose);
    if (tick == 150u) {
        pose.y += (REAL)0.03;
        status += OF(noslip_odometry_correct)(&self->odometry, &pose, NOSLIP_BUMPLESS);
    }
    status += tick % 100u == 99u ? OF(noslip_odometry_unwind)(&self->odometry) : 0;
    speed = (turned[0] + turned[1]) * 5;
    status += 10 * OF(noslip_path_step)(&self->path, pose.x, pose.y, self->odometry.direction, speed);
    status += 100 * OF(noslip_path_look)(&self->path, pose.x, pose.y, pose.heading, speed, &seen);
    status += OF(noslip_reversing)(NOSLIP_SWITCH, self->path.guide.speed, lookaheads, &self->which);
    status += OF(noslip_integral_step)(&self->integral, self->path.guide.foot.distance, ROUTE_PERIOD, NOSLIP_OK, &added);
    {
        const REAL all[] = {pose.x, pose.y, pose.heading, self->odometry.direction[0], self->odometry.direction[1], added,
                            self->path.guide.progress, self->path.guide.foot.distance, self->path.guide.foot.cosine,
                            self->path.guide.foot.sine, self->path.guide.foot.curvature, self->path.guide.speed,
                            self->path.guide.speed_rate, seen.remaining, seen.foot.distance};
        self->digest = digest_word(digest_reals(self->digest, all, sizeof all / sizeof all[0]), (uint32_t)status);
    }
    route_numbers(self, &pose);
    self->status = status;
}

/* The digest of all ticks. */
static uint32_t route_digest(void)
{
    route self;
    unsigned tick;
    route_begin(&self);
    for (tick = 0; tick < ROUTE_TICKS; tick++) {
        route_tick(&self, tick);
    }
    return self.digest;
}

#endif
