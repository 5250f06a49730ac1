/*
 * timing.c - calls of every entry point of the follower of a vehicle and of its parts, to be counted by timing.py.
 *
 * The vehicle of firmware/ drives along its path, as its model says; at each tick copies of the follower get counts that are
 * wrong or late. Three configs: motors with NOSLIP_SLOW; motors with NOSLIP_GRIP on a slippery floor, an approach and integral
 * action; velocity drives with limits of their accelerations.
 */
#include "labmate_telemetry_f.h"
#include "robot.h"

#define TICKS 2400
#define ONCE __attribute__((noipa)) /* GCC: not inlined, cloned or analysed for its caller */
#define COUNTS (40000.0f * 0.15915494f) /* per rad */
#define IMAGE 1024u

static labmate_follower_config_f config;
static labmate_follower_f self, copy;
static noslip_telemetry telemetry;
static noslip_record_f record;
static noslip_segment_f segments[ROBOT_SEGMENTS];
static uint8_t ring[2048], image[IMAGE], bytes[2048];
static uint32_t used;
static uint64_t random_state = 1992;
int status_of_last;

/* -- inline functions, as functions of their own ------------------------------------------------------------------- */

ONCE int noslip_encoder_read_f_(noslip_encoder_f *encoder, uint32_t counts, float *angle)
{
    return noslip_encoder_read_f(encoder, counts, angle);
}

ONCE int noslip_odometry_move_f_(noslip_odometry_f *odometry, const float turned[2], float dt, noslip_pose_f *pose)
{
    return noslip_odometry_move_f(odometry, turned, dt, pose);
}

ONCE int noslip_motor_step_f_(const noslip_motor_f *motor, float torque, float rate, float *command)
{
    return noslip_motor_step_f(motor, torque, rate, command);
}

ONCE int noslip_velocity_follow_f_(noslip_velocity_f *velocity, const float *desired, const float *nu, int status, float dt,
                                   float *command)
{
    return noslip_velocity_follow_f(velocity, desired, nu, status, dt, command);
}

ONCE int noslip_telemetry_record_f_(noslip_telemetry *to, noslip_record_f *of)
{
    return noslip_telemetry_record_f(to, of);
}

/* -- callers: the calls of the function NAME in call_NAME are counted ---------------------------------------------- */

#define CALL(name, parameters, arguments) \
    ONCE void call_##name parameters \
    { \
        status_of_last = name arguments; \
    }
CALL(labmate_follower_init_f, (void), (&self, &config))
CALL(labmate_follower_update_f, (const labmate_options_f *limits), (&self, &config.params, &config.gains, limits))
CALL(labmate_follower_tick_f, (labmate_follower_f * of, const uint32_t counts[2], uint32_t missed, float command[2]),
     (of, counts, missed, command))
CALL(labmate_follower_tick_angles_f, (labmate_follower_f * of, const float turned[2], float dt, float command[2]),
     (of, turned, dt, command))
CALL(labmate_follower_correct_f, (labmate_follower_f * of, const noslip_pose_f *truth), (of, truth, NOSLIP_BUMPLESS))
CALL(labmate_follower_reset_f, (labmate_follower_f * of), (of))
CALL(labmate_follower_twist_f, (float twist[2]), (&self, twist))
CALL(labmate_follower_record_f, (const uint32_t counts[2], const float command[2]), (&self, counts, 0, 0, command, &record))
CALL(labmate_follower_save_f, (void), (&config, image, IMAGE, &used))
CALL(labmate_follower_load_f, (labmate_follower_config_f * to), (to, segments, ROBOT_SEGMENTS, image, used))
CALL(labmate_follower_describe_f, (void), (&self, &telemetry, image, IMAGE))
CALL(noslip_telemetry_record_f_, (void), (&telemetry, &record))
CALL(noslip_telemetry_read, (void), (&telemetry, bytes, sizeof bytes, &used))
CALL(labmate_type_iv_segment_init_f, (labmate_type_iv_segment_f * law),
     (law, &config.params, &self.place, &config.gains, &config.limits))
CALL(labmate_type_iv_segment_update_f, (labmate_type_iv_segment_f * law), (law, &self.next))
CALL(labmate_type_iv_segment_set_limits_f, (labmate_type_iv_segment_f * law, const float limit[2]), (law, limit))
CALL(labmate_type_iv_segment_step_f, (labmate_type_iv_segment_f * law, const labmate_state_f *state, float tau[2]),
     (law, state, &self.reference, tau))
CALL(labmate_type_iv_segment_follow_f, (labmate_type_iv_segment_f * law, const labmate_state_f *state, float tau[2]),
     (law, &self.path.guide.foot, state, &self.reference, tau))
CALL(labmate_type_iv_segment_evaluate_f, (labmate_type_iv_segment_evaluation_f * all),
     (&self.law, &self.state, &self.reference, all))
CALL(labmate_dynamics_init_f, (labmate_dynamics_f * dynamics), (dynamics, &config.params))
CALL(labmate_dynamics_acceleration_f, (const float torque[2], float qdot[5], float u[2]),
     (&self.dynamics, &self.state, torque, qdot, u))
CALL(noslip_path_init_f, (noslip_path_f * path, const noslip_path_options_f *options),
     (path, config.segments, config.count, options, NULL))
CALL(noslip_path_update_f, (noslip_path_f * path, noslip_guide_f *guide),
     (path, self.odometry.pose.x, self.odometry.pose.y, self.odometry.pose.heading, self.speed, guide))
CALL(noslip_encoder_read_f_, (noslip_encoder_f * encoder, uint32_t counts, float *angle), (encoder, counts, angle))
CALL(noslip_odometry_move_f_, (noslip_odometry_f * odometry, const float turned[2], noslip_pose_f *pose),
     (odometry, turned, 0.01f, pose))
CALL(noslip_motor_step_f_, (float torque, float rate, float *command), (&self.motors[0], torque, rate, command))
CALL(noslip_velocity_follow_f_, (noslip_velocity_f * velocity, const float desired[2], float command[2]),
     (velocity, desired, self.rate, 0, 0.01f, command))
CALL(noslip_watchdog_step, (noslip_watchdog * watchdog, int status, uint32_t missed), (watchdog, status, missed, 0))

/* -- runs ---------------------------------------------------------------------------------------------------------- */

/* A number from -1 to 1. */
static float any(void)
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (float)(int32_t)(uint32_t)(random_state >> 32) * (1.0f / 2147483648.0f);
}

static void set_config(int kind)
{
    (void)robot_config(&config);
    if (kind == 1) {
        config.limits.on_limit = NOSLIP_GRIP;
        config.limits.friction.mu = 0.15f;
        config.limits.friction.margin = 0.05f;
        config.approach = 0.2f;
        config.settling = 0.5f;
        config.ki[0] = 0.1f;
        config.ki[1] = 0.1f;
        config.ki_limit[0] = 0.1f;
        config.ki_limit[1] = 0.1f;
    } else if (kind == 2) {
        int i;
        config.drive = NOSLIP_DRIVE_VELOCITY;
        config.along = 0.8f;
        config.lateral = 0.5f;
        for (i = 0; i < 2; i++) {
            config.velocity[i].speed = 20.0f;
            config.velocity[i].acceleration = 40.0f;
            config.velocity[i].band = 5.0f;
        }
    }
}

/* What is called now and then, on copies where it would disturb the run. */
static void call_parts(const uint32_t counts[2], const float turned[2], const float command[2])
{
    const float u_of[2] = {self.torque[0] + any(), self.torque[1] + any()};
    labmate_type_iv_segment_evaluation_f all;
    labmate_follower_config_f loaded = config;
    noslip_path_options_f options = config.path;
    noslip_pose_f pose = self.odometry.pose;
    labmate_state_f state = self.state;
    float qdot[5], pair[2], one;

    call_labmate_follower_twist_f(pair);
    call_labmate_follower_record_f(counts, command);
    call_noslip_telemetry_record_f_();
    call_labmate_follower_save_f();
    call_labmate_follower_load_f(&loaded);
    call_labmate_follower_describe_f();
    call_noslip_telemetry_read();
    copy = self;
    pose.x += 0.01f * any();
    call_labmate_follower_correct_f(&copy, &pose);
    call_labmate_follower_reset_f(&copy);
    call_labmate_type_iv_segment_init_f(&copy.next);
    call_labmate_type_iv_segment_update_f(&copy.law);
    state.thetadot_r += 4 * any();
    state.phi += any();
    call_labmate_type_iv_segment_step_f(&copy.law, &state, pair);
    call_labmate_type_iv_segment_follow_f(&copy.law, &state, pair);
    call_labmate_type_iv_segment_set_limits_f(&copy.law, u_of);
    call_labmate_type_iv_segment_evaluate_f(&all);
    call_labmate_dynamics_init_f(&copy.dynamics);
    call_labmate_dynamics_acceleration_f(u_of, qdot, pair);
    options.ahead = self.odometry.options.ahead;
    call_noslip_path_init_f(&copy.path, &options);
    call_noslip_encoder_read_f_(&copy.encoders[0], counts[0], &one);
    call_noslip_odometry_move_f_(&copy.odometry, turned, &pose);
    call_noslip_motor_step_f_(20 * any(), 20 * any(), &one);
    call_noslip_velocity_follow_f_(&copy.velocity, u_of, pair);
    call_noslip_watchdog_step(&copy.watchdog, any() > 0 ? 0 : NOSLIP_RANGE, any() > 0 ? 0 : 1);
}

/* Drives along the path, with a vehicle that does what the law asks. Returns 1 if it arrives. */
static int run(int kind)
{
    float rate[2] = {0, 0}, angle[2] = {0, 0}, command[2], ignored[2], qdot[5], u[2];
    int tick, arrived = 0;
    set_config(kind);
    call_labmate_follower_init_f();
    for (tick = 0; tick < TICKS; tick++) {
        const uint32_t counts[2] = {(uint32_t)(int32_t)(angle[0] * COUNTS), (uint32_t)(int32_t)(-angle[1] * COUNTS)};
        const float turned[2] = {0.01f * rate[0], 0.01f * rate[1]};
        uint32_t wrong[2];
        noslip_guide_f guide;
        labmate_options_f limits = config.limits;
        limits.limit[0] = limits.limit[1] = 15 + 5 * any();
        wrong[0] = counts[0] + (uint32_t)(int32_t)(1000 * any());
        wrong[1] = counts[1] + (uint32_t)(int32_t)(1000 * any());
        copy = self;
        call_noslip_path_update_f(&copy.path, &guide);
        call_labmate_follower_tick_f(&copy, wrong, tick % 2 ? 0 : 1, ignored);
        call_labmate_follower_tick_f(&copy, counts, 0, ignored);
        copy = self;
        call_labmate_follower_tick_angles_f(&copy, turned, 0.01f + 0.005f * any(), ignored);
        call_labmate_follower_tick_f(&self, counts, 0, command);
        if (self.last >= 0 && labmate_dynamics_acceleration_f(&self.dynamics, &self.state, self.torque, qdot, u) >= 0) {
            int i;
            for (i = 0; i < 2; i++) {
                rate[i] = kind == 2 ? command[i] : rate[i] + 0.01f * u[i];
                angle[i] += 0.01f * rate[i];
            }
        }
        arrived |= self.path.guide.segment == ROBOT_SEGMENTS - 1;
        if (tick % 8 == 0) {
            call_labmate_follower_update_f(&limits);
            call_parts(counts, turned, command);
        }
    }
    return arrived;
}

int main(void)
{
    int kind, arrived = 1;
    if (noslip_telemetry_init(&telemetry, ring, sizeof ring) < 0) {
        return 1;
    }
    for (kind = 0; kind < 3; kind++) {
        arrived &= run(kind);
    }
    return !arrived;
}
