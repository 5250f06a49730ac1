/* main.c - control loop: read, compute, drive at every tick, until the vehicle stands at the end of its path or stops. */
#include "board.h"
#include "robot.h"

#define STAND 300u    /* ticks from the end of the path to standstill */
#define LONGEST 6000u /* ticks: time limit */
#define RING 1024u    /* bytes of telemetry that wait: the config and some ticks */

/* What goes to the line. */
typedef struct line {
    noslip_telemetry telemetry;
    uint8_t ring[RING];
    uint8_t image[ROBOT_IMAGE];
} line;

static void send(line *to)
{
    uint8_t bytes[128];
    const uint32_t room = board_room();
    uint32_t count = 0;
    (void)noslip_telemetry_read(&to->telemetry, bytes, room < sizeof bytes ? room : (uint32_t)sizeof bytes, &count);
    board_send(bytes, count);
}

/* Sends what the tick was given and has computed. */
static void send_tick(line *to, const labmate_follower_f *robot, const uint32_t counts[2], uint32_t missed, int status,
                      const float command[2])
{
    noslip_record_f record;
    (void)labmate_follower_record_f(robot, counts, missed, status, command, &record);
    (void)noslip_telemetry_record_f(&to->telemetry, &record);
    send(to);
}

/* Follows the path; returns the exit code. */
static int follow(labmate_follower_f *robot, line *to, board_report *report)
{
    const noslip_guide_f *guide = &robot->path.guide;
    uint32_t counts[2], missed, standing = 0;
    float command[2];
    while (standing < STAND) {
        if (report->ticks == LONGEST) {
            return BOARD_LATE;
        }
        missed = board_wait();
        board_read(counts);
        report->status = labmate_follower_tick_f(robot, counts, missed, command);
        board_drive(command);
        board_alive();
        send_tick(to, robot, counts, missed, report->status, command);
        report->ticks++;
        report->missed += missed;
        standing += report->status == NOSLIP_ARRIVED;
        if (robot->watchdog.state == NOSLIP_WATCHDOG_STOP) {
            return BOARD_STOPPED;
        }
    }
    /* along and across the path */
    report->error = noslip_sqrt_f(guide->remaining * guide->remaining + guide->foot.distance * guide->foot.distance);
    return report->error <= ROBOT_TOLERANCE ? BOARD_ARRIVED : BOARD_ASTRAY;
}

int main(void)
{
    static const float none[2] = {0, 0};
    board_report report = {.code = BOARD_REFUSED};
    labmate_follower_config_f config;
    labmate_follower_f robot;
    line to;

    report.status = robot_config(&config);
    if (report.status >= 0) {
        report.status = labmate_follower_init_f(&robot, &config);
    }
    if (report.status >= 0) {
        report.status = noslip_telemetry_init(&to.telemetry, to.ring, RING);
    }
    if (report.status >= 0) {
        (void)labmate_follower_describe_f(&robot, &to.telemetry, to.image, ROBOT_IMAGE);
        report.code = board_start(config.period);
        if (report.code == BOARD_ARRIVED) {
            report.code = follow(&robot, &to, &report);
        }
        board_drive(none);
        send(&to); /* what is left of the last ticks */
        report.reason = robot.watchdog.reason;
        report.x = robot.odometry.pose.x;
        report.y = robot.odometry.pose.y;
        report.heading = robot.odometry.pose.heading;
    }
    return board_end(&report);
}
