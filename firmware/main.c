/* main.c - control loop: read, compute, drive at every tick, until the vehicle stands at the end of its path or stops. */
#include "board.h"
#include "robot.h"

#define STAND 300u    /* ticks from the end of the path to standstill */
#define LONGEST 6000u /* ticks: time limit */

/* Follows the path; returns the exit code. */
static int follow(labmate_follower_f *robot, board_report *report)
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

    report.status = robot_config(&config);
    if (report.status >= 0) {
        report.status = labmate_follower_init_f(&robot, &config);
    }
    if (report.status >= 0) {
        report.code = board_start(config.period);
        if (report.code == BOARD_ARRIVED) {
            report.code = follow(&robot, &report);
        }
        board_drive(none);
        report.reason = robot.watchdog.reason;
        report.x = robot.odometry.pose.x;
        report.y = robot.odometry.pose.y;
        report.heading = robot.odometry.pose.heading;
    }
    return board_end(&report);
}
