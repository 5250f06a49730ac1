/*
 * simulated.c - a board without hardware: encoders and motors of a simulated vehicle with the config of robot.h.
 *
 * Derived from the mechanics, independently of the code of the controller. With forward speed v and yaw rate w of the middle of the
 * axle, torques T of right and left wheel, total mass M, total inertia J about the middle of the axle:
 *     (M + 2 I_w / r^2) dv/dt = (T_r + T_l) / r + m_c d w^2
 *     (J + 2 I_w b^2 / r^2) dw/dt = (T_r - T_l) b / r - m_c d v w
 */
#include <stddef.h>

#include "../board.h"
#include "../robot.h"
#include "clock.h"
#include "semihosting.h"

#define STEPS 4      /* integration steps per tick */
#define ROOM 256u    /* bytes of telemetry per tick */
#define DRIFT 0.005f /* m: largest allowed error of dead reckoning at the end */

static labmate_follower_config_f robot;
static float x, y, heading, rate[2], command[2], fraction[2]; /* x, y: middle of the axle; fraction: of a count */
static uint32_t counter[2];
static float elapsed; /* s: since the counters were last read */
static int file;      /* for telemetry; negative: none */

/* Returns the torque (N m) at the wheel for a motor command, see noslip_motor.h. */
static float torque_of(const noslip_motor_settings_f *of, float command_value, float wheel_rate)
{
    const float emf = of->torque_constant * of->gear;
    const float current = of->mode == NOSLIP_MOTOR_CURRENT ? command_value : (command_value - emf * wheel_rate) / of->resistance;
    const float driven = emf * current, loss = driven * wheel_rate >= 0 ? of->efficiency : 1 / of->back_efficiency;
    return of->mode == NOSLIP_MOTOR_TORQUE ? command_value : driven * loss - of->friction * wheel_rate;
}

static void turn(int wheel, float angle)
{
    const float counts = fraction[wheel] + angle * robot.counts_per_turn[wheel] * 0.15915494f;
    const int32_t whole = (int32_t)counts;
    fraction[wheel] = counts - (float)whole;
    counter[wheel] += (uint32_t)whole;
}

static void move(float dt)
{
    const labmate_params_f *p = &robot.params;
    const float wheels = 2 * p->I_w / (p->r * p->r);
    const float mass = p->m_c + 2 * p->m_w + wheels;
    const float inertia = p->I_c + p->m_c * p->d * p->d + 2 * p->I_m + p->b * p->b * (2 * p->m_w + wheels);
    const float right = torque_of(&robot.motors[0], command[0], rate[0]);
    const float left = torque_of(&robot.motors[1], command[1], rate[1]);
    float v = (rate[0] + rate[1]) * p->r / 2, w = (rate[0] - rate[1]) * p->r / (2 * p->b);
    const float dv = ((right + left) / p->r + p->m_c * p->d * w * w) / mass * dt;
    const float dw = ((right - left) * p->b / p->r - p->m_c * p->d * v * w) / inertia * dt;
    float sine, cosine;
    v += dv / 2;
    w += dw / 2;
    noslip_sincos_f(heading + w * dt / 2, &sine, &cosine);
    x += v * cosine * dt;
    y += v * sine * dt;
    heading += w * dt;
    turn(0, (v + p->b * w) / p->r * dt);
    turn(1, (v - p->b * w) / p->r * dt);
    v += dv / 2;
    w += dw / 2;
    rate[0] = (v + p->b * w) / p->r;
    rate[1] = (v - p->b * w) / p->r;
}

/* Opens the file named by the command line "telemetry FILE"; returns -1 for any other. */
static int open_file(void)
{
    static const char option[] = "telemetry ";
    static char line[256];
    uint32_t block[3], i, length = 0;
    block[0] = (uint32_t)(uintptr_t)line;
    block[1] = (uint32_t)sizeof line;
    if (semihosting(SEMIHOSTING_COMMAND_LINE, block) != 0) {
        return -1;
    }
    for (i = 0; option[i] != 0; i++) {
        if (line[i] != option[i]) {
            return -1;
        }
    }
    while (line[i + length] != 0) {
        length++;
    }
    block[0] = (uint32_t)(uintptr_t)&line[i];
    block[1] = 5; /* "wb" */
    block[2] = length;
    return semihosting(SEMIHOSTING_OPEN, block);
}

int board_start(float period)
{
    float sine, cosine;
    int i;
    (void)robot_config(&robot);
    for (i = 0; i < 2; i++) {
        rate[i] = 0;
        command[i] = 0;
        fraction[i] = 0;
        counter[i] = 0;
    }
    elapsed = 0;
    file = open_file();
    noslip_sincos_f(robot.start.heading, &sine, &cosine);
    x = robot.start.x - robot.params.d * cosine;
    y = robot.start.y - robot.params.d * sine;
    heading = robot.start.heading;
    clock_start(period);
    return 0;
}

uint32_t board_wait(void)
{
    const uint32_t missed = clock_wait();
    elapsed += robot.period * ((float)missed + 1);
    return missed;
}

void board_read(uint32_t counts[2])
{
    const uint32_t mask = UINT32_MAX >> (32 - robot.counter_bits);
    for (; elapsed > robot.period / (2 * STEPS); elapsed -= robot.period / STEPS) {
        move(robot.period / STEPS);
    }
    counts[0] = counter[0] & mask;
    counts[1] = counter[1] & mask;
}

void board_drive(const float commands[2])
{
    command[0] = commands[0];
    command[1] = commands[1];
}

void board_alive(void)
{
}

uint32_t board_room(void)
{
    return ROOM;
}

void board_send(const uint8_t *bytes, uint32_t count)
{
    uint32_t block[3];
    if (file >= 0) {
        block[0] = (uint32_t)file;
        block[1] = (uint32_t)(uintptr_t)bytes;
        block[2] = count;
        (void)semihosting(SEMIHOSTING_WRITE, block);
    }
}

/* -- report ------------------------------------------------------------------------------------------------------------ */

static void say(const char *text)
{
    (void)semihosting(SEMIHOSTING_WRITE0, text);
}

static void say_number(uint32_t number)
{
    char digits[11];
    int i = 10;
    digits[i] = 0;
    do {
        digits[--i] = (char)('0' + number % 10);
        number /= 10;
    } while (number > 0);
    say(&digits[i]);
}

/* " name -1.234" */
static void say_real(const char *name, float number)
{
    const float size = noslip_abs_f(number);
    const uint32_t thousandths = size < 4e6f ? (uint32_t)(size * 1000 + 0.5f) : UINT32_MAX;
    say(name);
    say(number < 0 ? " -" : " ");
    say_number(thousandths / 1000);
    say(thousandths % 1000 < 10 ? ".00" : thousandths % 1000 < 100 ? ".0" : ".");
    say_number(thousandths % 1000);
}

int board_end(const board_report *report)
{
    const float ahead = robot.params.d;
    float sine, cosine, drift;
    int code = report->code;
    noslip_sincos_f(heading, &sine, &cosine);
    cosine = x + ahead * cosine - report->x;
    sine = y + ahead * sine - report->y;
    drift = noslip_sqrt_f(cosine * cosine + sine * sine);
    if (code == BOARD_ARRIVED && !(drift <= DRIFT)) {
        code = BOARD_ASTRAY;
    }
    say("status ");
    say(noslip_status_name(report->status));
    say(", watchdog ");
    say_number((uint32_t)report->reason);
    say(", ticks ");
    say_number(report->ticks);
    say(", missed ");
    say_number(report->missed);
    say_real(", x", report->x);
    say_real(", y", report->y);
    say_real(", heading", report->heading);
    say_real(", error", report->error);
    say_real(", drift", drift);
    say("\n");
    return code;
}
