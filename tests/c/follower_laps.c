/*
 * follower_laps.c - TICKS ticks at SPEED (m/s) of the follower in the scalar SUFFIX on a figure of eight, closed by a simulated
 * vehicle, beside a loop assembled from the parts, which sees the same counts. For torque and for velocity drives it prints the
 * number of ticks with an error, the number in which any bit of commands or pose differs, the largest distance (m) from the path,
 * and that of the reckoned pose from the exact sum of the same counts, with the constants as they are in the scalar.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#define JOINED(name, suffix) name##suffix
#define GLUED(name, suffix) JOINED(name, suffix)
#define OF(name) GLUED(name, SUFFIX)

#include HEADER

#define PERIOD ((REAL)0.01)
#define COUNTS 40000.0
#define RADIUS ((REAL)5)

static const OF(noslip_segment) segments[] = {
    {0, 0, 0, 1 / RADIUS, (REAL)6.283185307179586 * RADIUS, 0},
    {0, 0, 0, -1 / RADIUS, (REAL)6.283185307179586 * RADIUS, 0},
};

static int chosen(OF(labmate_follower_config) *config, noslip_drive drive)
{
    const OF(labmate_follower_config) made = {
        .period = PERIOD, .counts_per_turn = {(REAL)COUNTS, (REAL)-COUNTS}, .counter_bits = 16, .smoothing = (REAL)0.02,
        .fastest = 20, .start = {(REAL)0.02, (REAL)-0.03, 0}, .segments = segments, .count = 2,
        .path = {.speed = (REAL)SPEED, .deceleration = (REAL)0.4, .closed = 1}, .astray = (REAL)0.5, .gains = {1, (REAL)2.5, 2},
        .limits = {.limit = {20, 20}, .on_limit = NOSLIP_SLOW}, .drive = drive, .velocity = {{20, 15, 2}, {20, 15, 2}},
        .stuck_torque = 2, .watchdog = {3, 100, 50}};
    *config = made;
    return OF(labmate_default_params)(&config->params);
}

/* The loop as assembled from its parts. */
typedef struct {
    OF(labmate_type_iv_segment) law;
    OF(labmate_dynamics) dynamics;
    OF(noslip_odometry) odometry;
    OF(noslip_encoder) encoders[2];
    OF(noslip_path) path;
    OF(noslip_velocity) velocity;
    OF(labmate_state) state;
} loop;

static int start(loop *self, const OF(labmate_follower_config) *config)
{
    const OF(labmate_type_iv_segment_config) place = {0, 0, 0, 0, 0};
    OF(noslip_odometry_options) wheels;
    OF(noslip_path_options) along = config->path;
    int i, status = OF(noslip_odometry_differential)(&wheels, config->params.r, config->params.b, config->params.d);
    along.ahead = config->params.d;
    status |= OF(noslip_odometry_init)(&self->odometry, &wheels, &config->start);
    status |= OF(noslip_path_init)(&self->path, segments, 2, &along, NULL);
    status |= OF(labmate_type_iv_segment_init)(&self->law, &config->params, &place, &config->gains, &config->limits);
    status |= OF(labmate_dynamics_init)(&self->dynamics, &config->params);
    status |= OF(noslip_velocity_init)(&self->velocity, config->velocity, 2, PERIOD);
    for (i = 0; i < 2; i++) {
        status |= OF(noslip_encoder_init)(&self->encoders[i], config->counts_per_turn[i], config->counter_bits);
    }
    memset(&self->state, 0, sizeof self->state);
    return status;
}

static int tick(loop *self, const OF(labmate_follower_config) *config, const uint32_t counts[2], REAL command[2])
{
    const REAL share = PERIOD / (config->smoothing + PERIOD), per_period = 1 / PERIOD;
    const OF(noslip_guide) *guide = &self->path.guide;
    OF(labmate_type_iv_segment_reference) reference = {0};
    OF(noslip_pose) pose;
    REAL turned[2], rate[2], tau[2], qdot[5], u[2];
    int status;
    (void)OF(noslip_encoder_read)(&self->encoders[0], counts[0], &turned[0]);
    (void)OF(noslip_encoder_read)(&self->encoders[1], counts[1], &turned[1]);
    if (OF(noslip_abs)(self->odometry.pose.heading) > 4) {
        (void)OF(noslip_odometry_unwind)(&self->odometry);
    }
    status = OF(noslip_odometry_move)(&self->odometry, turned, PERIOD, &pose);
    rate[0] = turned[0] * per_period;
    rate[1] = turned[1] * per_period;
    self->state.thetadot_r += share * (rate[0] - self->state.thetadot_r);
    self->state.thetadot_l += share * (rate[1] - self->state.thetadot_l);
    self->state.x_c = pose.x;
    self->state.y_c = pose.y;
    self->state.phi = pose.heading;
    status = status < 0 ? status : OF(noslip_path_step)(&self->path, pose.x, pose.y, self->odometry.direction,
        self->odometry.options.forward[0] * self->state.thetadot_r + self->odometry.options.forward[1] * self->state.thetadot_l);
    reference.speed = guide->speed;
    reference.speed_rate = guide->speed_rate;
    status = status < 0 ? status : OF(labmate_type_iv_segment_follow)(&self->law, &guide->foot, &self->state, &reference, tau);
    if (status < 0 || config->drive == NOSLIP_DRIVE_TORQUE) {
        command[0] = tau[0];
        command[1] = tau[1];
        return status;
    }
    status = OF(labmate_dynamics_acceleration)(&self->dynamics, &self->state, tau, qdot, u) < 0 ? NOSLIP_SINGULAR : status;
    return OF(noslip_velocity_step)(&self->velocity, u, rate, status, PERIOD, command);
}

int main(void)
{
    static const noslip_drive drives[] = {NOSLIP_DRIVE_TORQUE, NOSLIP_DRIVE_VELOCITY};
    int which;
    for (which = 0; which < 2; which++) {
        OF(labmate_follower_config) config;
        OF(labmate_follower) follower;
        loop parts;
        double rate[2] = {0, 0}, turned[2] = {0, 0}, x, y, astray = 0, error = 0;
        long total[2] = {0, 0}, k, ticks = which ? TICKS / 10 : TICKS, refused = 0, different = 0;
        if (chosen(&config, drives[which]) < 0 || OF(labmate_follower_init)(&follower, &config) < 0 || start(&parts, &config) < 0) {
            return 1;
        }
        x = (double)config.start.x - (double)config.params.d;
        y = (double)config.start.y;
        for (k = 0; k < ticks; k++) {
            const OF(noslip_odometry_options) *wheels = &follower.odometry.options; /* with the constants as they are in SUFFIX */
            const double angle = (double)follower.encoders[0].angle, heading = (double)wheels->turn[0] * angle;
            const uint32_t counts[2] = {(uint32_t)total[0] & 0xffff, (uint32_t)-total[1] & 0xffff};
            const long before[2] = {total[0], total[1]};
            REAL command[2] = {0, 0}, other[2] = {0, 0};
            const int status = OF(labmate_follower_tick)(&follower, counts, 0, command);
            double way, from, turn, tau[2];
            int i;
            refused += status < 0;
            different += tick(&parts, &config, counts, other) != status || memcmp(command, other, sizeof command) != 0 ||
                         memcmp(&follower.odometry.pose, &parts.odometry.pose, sizeof parts.odometry.pose) != 0;
            if (k > 2000) {
                astray = fmax(astray, fabs((double)follower.path.guide.foot.distance));
                error = fmax(error, hypot((double)follower.odometry.now.at[0] - x, (double)follower.odometry.now.at[1] - y));
            }
            for (i = 0; i < 2; i++) { /* a vehicle whose masses do not couple, or whose drives are of first order, 5 Hz */
                tau[i] = which ? 0 : (double)command[i];
                rate[i] += which ? 0.27 * ((double)command[i] - rate[i]) : (double)PERIOD * tau[i] / 0.4;
                turned[i] += (double)PERIOD * rate[i];
                total[i] = lround(turned[i] / 6.283185307179586 * COUNTS);
            }
            from = heading * (double)(before[0] - before[1]);
            turn = heading * (double)(total[0] - total[1]) - from;
            way = (double)wheels->forward[0] * angle * (double)(total[0] - before[0] + total[1] - before[1]);
            x += way * cos(from + turn / 2) * (fabs(turn) > 1e-12 ? sin(turn / 2) / (turn / 2) : 1);
            y += way * sin(from + turn / 2) * (fabs(turn) > 1e-12 ? sin(turn / 2) / (turn / 2) : 1);
        }
        printf("%ld %ld %.9f %.9f\n", refused, different, astray, error);
    }
    return 0;
}
