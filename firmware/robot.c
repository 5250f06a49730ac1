/* robot.c - config of a LABMATE that turns around in a lane: forward into it, a cusp, and out in reverse. */
#include <stddef.h>

#include "robot.h"

#define QUARTER 1.5707963f /* rad */

static const noslip_segment_f segments[ROBOT_SEGMENTS] = {
    {.x = 0.0f, .y = 0.0f, .heading = 0.0f, .length = 3.0f},
    {.x = 3.0f, .y = 0.0f, .heading = 0.0f, .curvature = 0.4f, .length = 2.5f * QUARTER},
    {.x = 5.5f, .y = 2.5f, .heading = QUARTER, .length = 1.5f},
    {.x = 5.5f, .y = 4.0f, .heading = -QUARTER, .length = 1.0f, .backward = 1},
    {.x = 5.5f, .y = 3.0f, .heading = -QUARTER, .curvature = -0.4f, .length = 2.5f * QUARTER, .backward = 1},
    {.x = 3.0f, .y = 0.5f, .heading = 2.0f * QUARTER, .length = 1.0f, .backward = 1},
};

/* 24 V, 20 turns to one, 2 N m at the wheel per A */
#define MOTOR                                                                                                              \
    {                                                                                                                      \
        .mode = NOSLIP_MOTOR_VOLTAGE, .gear = 20.0f, .efficiency = 0.8f, .back_efficiency = 0.75f, .torque_constant = 0.1f, \
        .friction = 0.02f, .moving = 0.2f, .resistance = 1.0f, .current = 20.0f, .supply = 24.0f                           \
    }

int robot_config(labmate_follower_config_f *config)
{
    static const labmate_follower_config_f robot = {
        .period = 0.01f,
        .counts_per_turn = {40000.0f, -40000.0f}, /* 500 lines, 4 edges each, times the gear ratio; the left one is mounted the other way round */
        .counter_bits = 16,
        .smoothing = 0.02f,
        .fastest = 20.0f,
        .segments = segments,
        .count = ROBOT_SEGMENTS,
        .path = {.speed = 1.0f, .deceleration = 0.4f, .L = {0.0f, -0.6f}, .reversing = NOSLIP_SWITCH, .stop = NOSLIP_STOP_AXLE},
        .astray = 0.5f,
        .gains = {.kp_distance = 1.0f, .kd_distance = 2.5f, .kv_speed = 2.0f},
        .limits = {.limit = {20.0f, 20.0f}, .on_limit = NOSLIP_SLOW},
        .motors = {MOTOR, MOTOR},
        .stuck_torque = 2.0f,
        .watchdog = {.tolerated = 3, .forgiven = 100, .stuck = 50},
    };
    if (config == NULL) {
        return NOSLIP_NULL;
    }
    *config = robot;
    (void)labmate_default_params_f(&config->params);
    return NOSLIP_OK;
}
