/*
 * outputs_calls.c - calls every entry point that has outputs with seeded arguments, valid and invalid, and prints for each the number
 * of calls that wrote a number of its output more than once, and the number of successful calls.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "labmate_dynamics_f.h"
#include "labmate_type_iv_segment_f.h"
#include "noslip_angle.h"
#include "noslip_approach.h"
#include "noslip_integral.h"
#include "noslip_motor.h"
#include "noslip_odometry.h"
#include "noslip_path.h"
#include "noslip_profile.h"
#include "noslip_slip.h"
#include "noslip_velocity.h"
#include "outputs.h"

#define CALLS 2000
#define LAW(name) labmate_type_iv_segment_##name##_f
#define PLANT(name) labmate_dynamics_##name##_f

static uint32_t seed = 1992;

/* Of ordinary size; one in 50 is not finite or overflows. */
static float number(void)
{
    seed = seed * 1664525u + 1013904223u;
    if (seed >> 8 & 0xff ? 0 : 1) {
        return seed >> 31 ? NAN : 3e38f;
    }
    return (float)(int32_t)seed / 1e9f;
}

static void fill(void *values, size_t size)
{
    size_t i;
    for (i = 0; i < size / sizeof(float); i++) {
        ((float *)values)[i] = number();
    }
}

#define COUNT(name, output, call) \
    do { \
        int status_; \
        watch(&(output), sizeof(output)); \
        status_ = (call); \
        twice[name] += unwatch() > 0; \
        good[name] += status_ >= 0; \
    } while (0)

enum { STEP, FOLLOW, OUTPUT, RATE, DECOUPLING, DECOUPLING_RATE, FEEDBACK, EVALUATE, REDUCED, ACCELERATION, ALL_DYNAMICS, MOVE, READ,
       LOOK, UPDATE, INTEGRAL, VELOCITY, ANGLE, DIFFERENTIAL, INIT_PATH, MOTOR, MOTOR_LIMIT, GRIP, FOLLOW_GRIP,
       GROUND, GROUND_BY_INPUTS, APPROACH, APPROACH_WITHIN, PROFILE, SLIP, SLIP_GRIP, NAMES };
static const char *names[NAMES] = {"step", "follow", "output", "rate", "decoupling", "decoupling_rate", "feedback", "evaluate",
                                   "reduced", "acceleration", "dynamics", "move", "read", "look", "update", "integral", "velocity",
                                   "angle", "differential", "path_init", "motor", "motor_limit", "grip",
                                   "follow_grip", "ground", "ground_by_inputs", "approach", "approach_within", "profile", "slip",
                                   "slip_grip"};
static int twice[NAMES], good[NAMES];

int main(void)
{
    static const noslip_segment_f segments[] = {{0, 0, 0, 0, 2, 0}, {2, 0, 0, 0.5f, 3, 0}};
    const labmate_type_iv_segment_config_f config = {0.25f, 0, 0, 0, 0.25f};
    const labmate_type_iv_segment_gains_f gains = {4, 4, 2};
    const noslip_path_options_f along = {.speed = 1, .deceleration = 0.5f, .L = {0.3f, -0.3f}};
    const labmate_options_f options = {.limit = {7, 7}, .on_limit = NOSLIP_SLOW};
    const labmate_options_f rolling = {.limit = {7, 7}, .on_limit = NOSLIP_GRIP, .friction = {.mu = 0.5f, .height = 0.1f}};
    const noslip_profile_limits_f fastest = {1, 1, 0.5f, 0, 0};
    const noslip_slip_options_f noticing = {0.2f, {0.001f, 0.001f}, 0, 0.003f, 0.002f, 0.1f, 0.1f, 0.005f, 6, 0.5f, 0.1f, 0.8f,
                                            0.1f, 0.05f, 1};
    labmate_params_f params;
    labmate_type_iv_segment_f law, gripping;
    labmate_dynamics_f plant;
    noslip_odometry_f odometry;
    noslip_odometry_options_f wheels;
    noslip_path_f path, other;
    noslip_integral_f integral;
    const noslip_velocity_limits_f wheels_at_most[2] = {{2, 5, 1}, {2, 5, 1}};
    noslip_velocity_f velocity;
    noslip_encoder_f encoder;
    const noslip_motor_settings_f wheel = {NOSLIP_MOTOR_DUTY, 20, 0.8f, 0.7f, 0.05f, 0.02f, 0.1f, 0.2f, 1, 10, 24};
    noslip_motor_f motor;
    noslip_approach_f approach;
    noslip_profile_f profile;
    noslip_slip_f slip;
    float squares[2];
    int k, status = labmate_default_params_f(&params);
    status += LAW(init)(&law, &params, &config, &gains, &options) + labmate_dynamics_init_f(&plant, &params);
    status += noslip_odometry_differential_f(&wheels, 0.1f, 0.25f, 0.05f) + noslip_odometry_init_f(&odometry, &wheels, NULL);
    status += noslip_path_init_f(&path, segments, 2, &along, NULL) + noslip_integral_init_f(&integral, 1, 0.5f);
    status += noslip_encoder_init_f(&encoder, 4096, 16) + noslip_velocity_init_f(&velocity, wheels_at_most, 2, 0.01f);
    status += noslip_motor_init_f(&motor, &wheel) + LAW(init)(&gripping, &params, &config, &gains, &rolling);
    status += noslip_approach_init_f(&approach, 0.5f, 0.25f, 0) + noslip_profile_init_f(&profile, segments, 2, &along, &fastest, squares);
    status += noslip_slip_init_f(&slip, &noticing, &wheels);
    for (k = 0; k < CALLS && status == 0; k++) {
        labmate_state_f state;
        LAW(reference) reference;
        LAW(evaluation) all;
        labmate_dynamics_evaluation_f everything;
        noslip_foot_f foot;
        noslip_pose_f pose;
        noslip_guide_f guide;
        struct {
            float Mbar[2][2], bias[2];
        } reduced;
        struct {
            float qdot[5], nudot[2];
        } rates;
        noslip_approached_f desired;
        noslip_slip_reading_f reading;
        noslip_noticed_f noticed;
        noslip_grip_f grip;
        struct {
            float speed, rate;
        } fast;
        float tau[2], ground[8], by_inputs[6][2], h[2], ydot[1], Phi[2][2], v[2], one;
        noslip_path_fault_f fault;
        fill(&state, sizeof state);
        fill(&reference, sizeof reference);
        fill(&foot, sizeof foot);
        fill(v, sizeof v);
        COUNT(STEP, tau, LAW(step)(&law, &state, &reference, tau));
        COUNT(FOLLOW, tau, LAW(follow)(&law, &foot, &state, &reference, tau));
        COUNT(OUTPUT, h, LAW(output)(&law, &state, h));
        COUNT(RATE, ydot, LAW(rate)(&law, &state, ydot));
        COUNT(DECOUPLING, Phi, LAW(decoupling)(&law, &state, Phi));
        COUNT(DECOUPLING_RATE, Phi, LAW(decoupling_rate)(&law, &state, Phi));
        COUNT(FEEDBACK, tau, LAW(feedback)(&law, &state, v, tau));
        COUNT(EVALUATE, all, LAW(evaluate)(&law, &state, &reference, &all));
        COUNT(REDUCED, reduced, PLANT(reduced)(&plant, &state, reduced.Mbar, reduced.bias));
        COUNT(ACCELERATION, rates, PLANT(acceleration)(&plant, &state, v, rates.qdot, rates.nudot));
        COUNT(ALL_DYNAMICS, everything, PLANT(evaluate)(&plant, &state, &everything));
        COUNT(MOVE, pose, noslip_odometry_move_f(&odometry, v, number(), &pose));
        COUNT(READ, one, noslip_encoder_read_f(&encoder, seed, &one));
        COUNT(LOOK, guide, noslip_path_look_f(&path, number(), number(), number(), number(), &guide));
        COUNT(UPDATE, guide, noslip_path_update_f(&path, number(), number(), number(), number(), &guide));
        COUNT(INTEGRAL, one, noslip_integral_step_f(&integral, number(), number(), NOSLIP_OK, &one));
        COUNT(VELOCITY, tau, noslip_velocity_step_f(&velocity, v, h, NOSLIP_OK, k % 9 ? 0.01f : number(), tau));
        COUNT(ANGLE, one, noslip_nearest_angle_f(number(), number(), &one));
        COUNT(DIFFERENTIAL, wheels, noslip_odometry_differential_f(&wheels, number(), number(), number()));
        COUNT(INIT_PATH, fault, noslip_path_init_f(&other, segments, (int)(seed >> 31), &along, &fault));
        COUNT(MOTOR, one, noslip_motor_step_f(&motor, number(), number(), &one));
        COUNT(MOTOR_LIMIT, one, noslip_motor_limit_f(&motor, number(), &one));
        COUNT(GRIP, tau, LAW(step)(&gripping, &state, &reference, tau));
        COUNT(FOLLOW_GRIP, tau, LAW(follow)(&gripping, &foot, &state, &reference, tau));
        COUNT(GROUND, ground, LAW(ground)(&gripping, &state, v, ground));
        COUNT(GROUND_BY_INPUTS, by_inputs, LAW(ground_by_inputs)(&gripping, &state, by_inputs));
        COUNT(APPROACH, desired, noslip_approach_step_f(&approach, k % 9 ? 0.01f : number(), number(), &desired));
        COUNT(APPROACH_WITHIN, desired, noslip_approach_within_f(&approach, number(), number(), &desired));
        COUNT(PROFILE, fast, noslip_profile_speed_f(&profile, &guide, number(), &fast.speed, &fast.rate));
        fill(&reading, sizeof reading);
        COUNT(SLIP, noticed, noslip_slip_step_f(&slip, &reading, k % 9 ? 0.01f : number(), &noticed));
        COUNT(SLIP_GRIP, grip, noslip_slip_grip_f(&slip, &gripping.earned, &grip));
        status = k % 20 == 0 ? noslip_path_init_f(&path, segments, 2, &along, NULL) : 0; /* for the next calls */
    }
    for (k = 0; k < NAMES; k++) {
        printf("%s %d %d\n", names[k], twice[k], good[k]);
    }
    return status;
}
