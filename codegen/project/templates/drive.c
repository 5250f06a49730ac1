{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro r(name) %}@{ own(robot ~ "_" ~ name) }{% endmacro %}
/*
 * drive.c - drives the vehicle of vehicle.c along its path, on this processor: the follower, and the dynamics of the robot
 * in place of its wheels. Prints a row at each tick, as CSV in SI; the exit code is 0 unless the watchdog stopped it, as it
 * does where the vehicle is farther from the path than it may be.
 *
 * Between two ticks the dynamics are integrated by @{ steps } steps of Runge and Kutta's method of order 4@{ ", with the loops of the drives" if drives }.
 */
#include "console.h"
#include "vehicle.h"

#define STEPS @{ steps }      /* of the integration, in a tick */
#define TICKS @{ ticks }u
#define LATE @{ late }       /* steps from a command until it acts */
#define WAITING (LATE / STEPS + 2) /* commands that have not acted yet, and the one that acts */

typedef union {
    @{ r("state") } value;
    @{ real } member[sizeof(@{ r("state") }) / sizeof(@{ real })];
} state;

#define MEMBERS ((int)(sizeof(@{ r("state") }) / sizeof(@{ real })))
#define COORDINATES @{ coordinates | length }

typedef struct {
    state x;
    @{ r("dynamics") } dynamics;
    @{ real } given[WAITING][2];
} plant;

static const @{ real } turn = @{ literal(6.283185307179586) };

/* Returns the rate of the state under a command. */
static int rate(const plant *self, const state *x, const @{ real } command[2], state *dx)
{
{% if drives %}
    static const @{ real } none[2] = {0, 0}, most[2] = @{ most };
    const int status = @{ r("dynamics_acceleration") }(&self->dynamics, &x->value, none, dx->member, dx->member + COORDINATES);
    int i;
    for (i = 0; i < 2; i++) {
        const @{ real } wanted = @{ omega } * (command[i] - x->member[COORDINATES + i]);
        dx->member[COORDINATES + i] = wanted > most[i] ? most[i] : wanted < -most[i] ? -most[i] : wanted;
    }
    return status;
{% else %}
    return @{ r("dynamics_acceleration") }(&self->dynamics, &x->value, command, dx->member, dx->member + COORDINATES);
{% endif %}
}

/* Integrates one step of h seconds. */
static int step(plant *self, const @{ real } command[2], @{ real } h)
{
    static const @{ real } part[4] = {0, @{ literal(0.5) }, @{ literal(0.5) }, 1}, weight[4] = {1, 2, 2, 1};
    state sum, slope, at;
    int i, k, status = NOSLIP_OK;
    for (i = 0; i < MEMBERS; i++) {
        sum.member[i] = 0;
        slope.member[i] = 0;
    }
    for (k = 0; k < 4 && status >= 0; k++) {
        for (i = 0; i < MEMBERS; i++) {
            at.member[i] = self->x.member[i] + part[k] * h * slope.member[i];
        }
        status = rate(self, &at, command, &slope);
        for (i = 0; i < MEMBERS; i++) {
            sum.member[i] += weight[k] * slope.member[i];
        }
    }
    for (i = 0; i < MEMBERS; i++) {
        self->x.member[i] += h / 6 * sum.member[i];
    }
    return status;
}

/* Integrates a tick: the command of `tick` acts LATE steps after its beginning. */
static int move(plant *self, unsigned tick, const @{ real } command[2], @{ real } period)
{
    int k, i, status = NOSLIP_OK;
    for (i = 0; i < 2; i++) {
        self->given[tick % WAITING][i] = command[i];
    }
    for (k = 0; k < STEPS && status >= 0; k++) {
        const unsigned age = k >= LATE % STEPS ? LATE / STEPS : LATE / STEPS + 1;
        status = step(self, self->given[(tick + WAITING - age) % WAITING], period / STEPS);
    }
    return status;
}

/* Returns the counter of a wheel at an angle. */
static uint32_t counter(@{ real } angle, @{ real } counts_per_turn, int bits)
{
    const @{ real } counts = angle / turn * counts_per_turn;
    const int32_t whole = (int32_t)counts;
    return (uint32_t)(whole - (counts < (@{ real })whole)) & (UINT32_MAX >> (32 - bits));
}

/* -- rows -------------------------------------------------------------------------------------------------------------- */

typedef struct {
    char text[400];
    int length;
} row;

static void put(row *to, char letter)
{
    if (to->length < (int)sizeof to->text - 1) {
        to->text[to->length++] = letter;
        to->text[to->length] = 0;
    }
}

static void put_whole(row *to, uint32_t number, int digits)
{
    uint32_t unit = 1;
    while (digits > 1 || number / unit >= 10) {
        unit *= 10;
        digits--;
    }
    for (; unit > 0; unit /= 10) {
        put(to, (char)('0' + number / unit % 10));
    }
}

/* Adds a number with six decimals, and what follows it; those too large for 32 bits as they are printed then. */
static void put_real(row *to, @{ real } number, char after)
{
    const @{ real } size = @{ n("abs") }(number);
    const uint32_t whole = size < @{ literal(4.0e9) } ? (uint32_t)size : UINT32_MAX;
    uint32_t decimals = size < @{ literal(4.0e9) } ? (uint32_t)((size - (@{ real })whole) * 1000000 + @{ literal(0.5) }) : 0;
    const uint32_t carried = decimals >= 1000000 ? 1 : 0;
    decimals -= carried * 1000000;
    if (number < 0) {
        put(to, '-');
    }
    put_whole(to, whole + carried, 1);
    put(to, '.');
    put_whole(to, decimals, 6);
    put(to, after);
}

static void say_row(const plant *self, const @{ r("follower") } *follower, @{ real } t, const @{ real } command[2], int status)
{
    const char *name = noslip_status_name(status);
    row to;
    int i;
    to.length = 0;
    put_real(&to, t, ',');
    for (i = 0; i < MEMBERS; i++) {
        put_real(&to, self->x.member[i], ',');
    }
    put_real(&to, command[0], ',');
    put_real(&to, command[1], ',');
    put_real(&to, follower->path.guide.foot.distance, ',');
    while (*name) {
        put(&to, *name++);
    }
    put(&to, '\n');
    say(to.text);
}

int main(void)
{
    static const @{ r("params") } params = @{ plant };
    static const @{ r("state") } start = @{ start };
    static const @{ real } counts_per_turn[2] = @{ counts };
    const @{ r("follower_config") } *config = vehicle_config();
    @{ r("follower") } follower;
    plant on;
    uint32_t counts[2];
    @{ real } command[2];
    unsigned tick, i;
    int at_tick;
    int status = @{ r("follower_init") }(&follower, config);
    if (status >= 0) {
        status = @{ r("dynamics_init") }(&on.dynamics, &params);
    }
    on.x.value = start;
    for (i = 0; i < WAITING; i++) {
        on.given[i][0] = @{ "start." ~ velocities[0] if drives else "0" };
        on.given[i][1] = @{ "start." ~ velocities[1] if drives else "0" };
    }
    say("t,@{ (coordinates + velocities) | join(",") },command_@{ velocities[0] if drives else inputs[0] },command_@{ velocities[1] if drives else inputs[1] },distance,status\n");
    for (tick = 0; tick <= TICKS && status >= 0 && follower.watchdog.state != NOSLIP_WATCHDOG_STOP; tick++) {
        counts[0] = counter(on.x.value.@{ angles[0] }, counts_per_turn[0], config->counter_bits);
        counts[1] = counter(on.x.value.@{ angles[1] }, counts_per_turn[1], config->counter_bits);
        at_tick = @{ r("follower_tick") }(&follower, counts, 0, command);
        say_row(&on, &follower, (@{ real })tick * config->period, command, at_tick);
        status = move(&on, tick, command, config->period);
    }
    if (status < 0) {
        say(noslip_status_name(status));
        say("\n");
    }
    return status < 0 || follower.watchdog.state == NOSLIP_WATCHDOG_STOP;
}
