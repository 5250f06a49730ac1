{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro r(name) %}@{ own(robot ~ "_" ~ name) }{% endmacro %}
{% set M = state | length %}
/*
 * drive.c - drives the vehicle of vehicle.c along its path, on this processor: the follower, and the robot in place of
 * its wheels. Prints what `noslip simulate` writes, byte for byte, where the SPEC has `backend = "cf"`: CSV, in SI. The
 * exit code is 0 unless the watchdog stopped the vehicle, as it does where it is farther from the path than it may be.
 *
 * Between two ticks the robot's equations of motion are integrated in double, by the method of order 5 of Dormand and
 * Prince with steps that keep its error within TOLERANCE.
 */
#include "console.h"
#include "decimal.h"
{% if noise %}
#include "noise.h"
{% endif %}
#include "noslip_trig.h"
#include "vehicle.h"

#define PERIOD @{ exact(period) } /* s: between two ticks */
#define OUTPUT_STEP @{ exact(output_step) } /* s: between two rows */
#define DURATION @{ exact(duration) } /* s */
#define ROWS @{ rows } /* before the one at DURATION */
#define TOLERANCE @{ exact(tolerance) } /* of the integration, relative and absolute */
#define SHORTEST 1e-9 /* s: where a step as short as this has too large an error, a number is not finite */
#define LATE @{ late[0] } /* whole periods from a tick until its command acts, */
#define LATER @{ exact(late[1]) } /* and the rest of that time, s */
#define WAITING (LATE + 2) /* most commands that have not acted yet */
#define SLACK (1e-9 * (PERIOD < OUTPUT_STEP ? PERIOD : OUTPUT_STEP)) /* s: a row this near to a tick belongs to it */
#define STATES @{ M }
#define STAGES 7 /* of the integration */

static const struct {
    double @{ parameters | join(", ") };
} robot = {@{ plant }};

/* -- the robot --------------------------------------------------------------------------------------------------------- */

{% if drives %}
/* The rates of the wheels that the loops of the drives cause. */
static void driven(const double x[STATES], const double command[2], double nudot[2])
{
    static const double most[2] = {@{ most | join(", ") }}; /* rad/s^2 */
    int i;
    for (i = 0; i < 2; i++) {
        const double wanted = @{ exact(omega) } * (command[i] - x[STATES - 2 + i]);
        nudot[i] = wanted > most[i] ? most[i] : wanted < -most[i] ? -most[i] : wanted;
    }
}

static void torques(const double x[STATES], const double nudot[2], double tau[2])
{
@{ made.torque }
}

static void rate(const double x[STATES], const double given[2], double xdot[STATES])
{
    double nudot[2];
    driven(x, given, nudot);
    {
@{ made.rate }
    }
}
{% else %}
/* The rate of the state (11). */
static void rate(const double x[STATES], const double tau[2], double xdot[STATES])
{
@{ made.rate }
}
{% endif %}

/* Outputs (14) on a piece of the path. */
static void outputs(const double x[STATES], const double place[@{ places[0] | length }], double y[2])
{
@{ made.outputs }
}

/* Constraint forces, lambda of (8). */
static void constraint_forces(const double x[STATES], const double tau[2], double force[@{ forces }])
{
@{ made.forces }
}
{% if contacts %}

/* The part of friction that each contact uses: its force over mu times its load; infinite without load. */
static void friction_use(const double x[STATES], const double tau[2], double use[@{ contacts | length }])
{
    double load[3 * @{ contacts | length }];
    noslip_bits infinite;
    int i;
    infinite.bits = UINT64_C(0x7ff0000000000000);
    {
@{ loads }
    }
    for (i = 0; i < @{ contacts | length }; i++) {
        const double *at = load + 3 * i;
        const double force = noslip_sqrt(at[0] * at[0] + at[1] * at[1]);
        use[i] = at[2] > 0 ? force / at[2] / @{ exact(mu) } : infinite.value;
    }
}
{% endif %}

/* -- its motion -------------------------------------------------------------------------------------------------------- */

/* Takes a step of h seconds; returns the square of its error: 1 is the tolerance. */
static double step(const double x[STATES], const double given[2], double h, double after[STATES])
{
    static const double weight[STAGES - 1][STAGES - 1] = {
        {1.0 / 5},
        {3.0 / 40, 9.0 / 40},
        {44.0 / 45, -56.0 / 15, 32.0 / 9},
        {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
        {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
        {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
    };
    static const double difference[STAGES] = {71.0 / 57600,      0,           -71.0 / 16695, 71.0 / 1920,
                                              -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
    double slope[STAGES][STATES], error = 0;
    int i, k, m;
    rate(x, given, slope[0]);
    for (k = 1; k < STAGES; k++) {
        for (i = 0; i < STATES; i++) {
            double sum = 0;
            for (m = 0; m < k; m++) {
                sum += weight[k - 1][m] * slope[m][i];
            }
            after[i] = x[i] + h * sum;
        }
        rate(after, given, slope[k]);
    }
    for (i = 0; i < STATES; i++) {
        const double size = noslip_abs(x[i]) > noslip_abs(after[i]) ? noslip_abs(x[i]) : noslip_abs(after[i]);
        double sum = 0;
        for (k = 0; k < STAGES; k++) {
            sum += difference[k] * slope[k][i];
        }
        sum = h * sum / (TOLERANCE * (1 + size));
        error += sum * sum;
    }
    return error / STATES;
}

/* Moves the robot for a duration with what the drives are given held. */
static int hold(double x[STATES], const double given[2], double duration)
{
    double left = duration, h = duration, after[STATES];
    int i;
    while (left > 0) {
        double error;
        h = h < left ? h : left;
        error = step(x, given, h, after);
        if (!(error <= 1)) {
            if (h <= SHORTEST) {
                return NOSLIP_NONFINITE;
            }
            h *= 0.5;
            continue;
        }
        for (i = 0; i < STATES; i++) {
            x[i] = after[i];
        }
        left -= h;
        h *= error < 1e-4 ? 2 : 1;
    }
    return NOSLIP_OK;
}

/* -- the drive --------------------------------------------------------------------------------------------------------- */

/* A row, SI. */
typedef struct {
    double t;
    double x[STATES]; /* the true state: @{ state | join(", ") } */
    double tau[2];    /* inputs of the robot: @{ inputs | join(", ") } */
    double y[2];      /* true outputs: distance, speed */
    double desired[2];
    double force[@{ forces }]; /* constraint forces, lambda of (8) */
    double seen[STATES]; /* the state that the follower sees */
    double integral[2];
    double command[2]; /* what the drives are given */
    double believed;   /* friction */
{% if contacts %}
    double use[@{ contacts | length }]; /* of friction, by each contact */
{% endif %}
    int piece;  /* of the path */
    int status; /* of the follower's law, or its error */
} drive_row;

static const double per_count[2] = {6.283185307179586 / @{ counts[0] }, 6.283185307179586 / @{ counts[1] }}; /* rad */
static const double place[][@{ places[0] | length }] = { /* of each piece: @{ config | join(", ") } */
{% for each in places %}
    {@{ each | join(", ") }},
{% endfor %}
};

typedef struct {
    double when; /* s */
    double given[2];
} command_given;

typedef struct {
    double t, x[STATES], held[2]; /* held: what the drives are given */
{% if noise %}
    double before[2], turned[2]; /* rad: the wheels at the last tick; their encoders */
    double noise[2];             /* rad/s: of the rates */
    double sample;               /* its number, or its time */
    uint64_t draws;
{% endif %}
    command_given waiting[WAITING];
    int first, count; /* of those that wait */
    long rows;        /* that have been printed */
    drive_row row;
} run;

static void say_numbers(const double *numbers, int count)
{
    char text[DECIMAL_SIZE];
    int i;
    for (i = 0; i < count; i++) {
        decimal_write(text, numbers[i]);
        say(",");
        say(text);
    }
}

/* Prints a row as CSV. */
static void say_row(const drive_row *row)
{
    char text[DECIMAL_SIZE];
    const double piece = row->piece;
    decimal_write(text, row->t);
    say(text);
    say_numbers(row->x, STATES);
    say_numbers(row->tau, 2);
    say_numbers(row->y, 2);
    say(",");
    say(noslip_status_name(row->status));
    say_numbers(row->force, @{ forces });
{% if contacts %}
    say_numbers(row->use, @{ contacts | length });
{% endif %}
    say_numbers(row->seen, STATES);
{% for k in integrals %}
    say_numbers(row->integral + @{ k }, 1);
{% endfor %}
{% if drives %}
    say_numbers(row->command, 2);
{% endif %}
{% if earned %}
    say_numbers(&row->believed, 1);
{% endif %}
    say_numbers(&piece, 1);
#if defined(DRIVE_DESIRED) /* for `noslip simulate` */
    say_numbers(row->desired, 2);
#endif
    say("\n");
}

/* Returns the largest integer not above a number. */
static int32_t floor_of(double number)
{
    const int32_t whole = (int32_t)number;
    return whole - (number < (double)whole);
}

{% if noise %}
/* Draws the noise of the wheels' rates. */
static void draw(run *self)
{
    static const double mean[2] = {@{ mean | join(", ") }}, deviation[2] = {@{ deviation | join(", ") }}; /* rad/s */
    double normal[2];
    int i;
    noise_normal(UINT64_C(@{ noise.seed }), self->draws++, 2, normal);
    for (i = 0; i < 2; i++) {
        self->noise[i] = mean[i] + deviation[i] * normal[i];
    }
}

/* Turns the encoders with the wheels, and by the noise of their rates since the last tick. */
static void read(run *self)
{
    const double angle[2] = {self->x[@{ angles[0] }], self->x[@{ angles[1] }]};
    const double sample = @{ "floor_of(self->t / " ~ exact(noise.period) ~ " + 1e-9)" if noise.period else "self->t" };
    int i;
    for (i = 0; i < 2; i++) {
        self->turned[i] += angle[i] - self->before[i] + self->noise[i] * (self->t > 0 ? PERIOD : 0);
        self->before[i] = angle[i];
    }
    if (sample > self->sample) {
        draw(self);
        self->sample = sample;
    }
}
{% endif %}

/* Calls the follower with the counters of the wheels, and notes what it sees. */
static int tick(run *self, @{ r("follower") } *follower, int bits)
{
    drive_row *row = &self->row;
{% set turned = ["self->turned[0]", "self->turned[1]"] if noise else ["self->x[" ~ angles[0] ~ "]", "self->x[" ~ angles[1] ~ "]"] %}
    const int32_t whole[2] = {floor_of(@{ turned[0] } / per_count[0]), floor_of(@{ turned[1] } / per_count[1])};
    const uint32_t mask = UINT32_MAX >> (32 - bits), counts[2] = {(uint32_t)whole[0] & mask, (uint32_t)whole[1] & mask};
    command_given *last = &self->waiting[(self->first + self->count) % WAITING];
    @{ real } command[2];
    int i, status = @{ r("follower_tick") }(follower, counts, 0, command);
    for (i = 0; i < STATES; i++) {
        row->seen[i] = self->x[i];
    }
{% for name, k in placed.items() %}
    row->seen[@{ k }] = (double)follower->state.@{ name };
{% endfor %}
    for (i = 0; i < 2; i++) {
        row->integral[i] = (double)follower->integrals[i].z;
        last->given[i] = (double)command[i];
    }
    row->seen[@{ angles[0] }] = whole[0] * per_count[0];
    row->seen[@{ angles[1] }] = whole[1] * per_count[1];
    row->desired[0] = (double)follower->reference.distance;
    row->desired[1] = (double)follower->reference.speed;
    row->believed = @{ "(double)follower->law.earned.mu" if earned else "0" };
    row->piece = follower->path.guide.segment;
    row->status = status == NOSLIP_ARRIVED ? follower->last : status;
    self->count++;
    return follower->watchdog.state == NOSLIP_WATCHDOG_STOP ? row->status : NOSLIP_OK;
}

/* Prints a row at the present state; with an error that ended the drive, no torque. */
static void show(run *self, int status, double t)
{
    drive_row *row = &self->row;
    int i;
    row->t = t;
    row->status = status < 0 ? status : row->status;
    for (i = 0; i < STATES; i++) {
        row->x[i] = self->x[i];
    }
    for (i = 0; i < 2; i++) {
        row->command[i] = status < 0 ? 0 : self->held[i];
    }
{% if drives %}
    {
        double nudot[2];
        driven(row->x, row->command, nudot);
        torques(row->x, nudot, row->tau);
        for (i = 0; i < 2; i++) {
            row->tau[i] = status < 0 ? 0 : row->tau[i];
        }
    }
{% else %}
    for (i = 0; i < 2; i++) {
        row->tau[i] = row->command[i];
    }
{% endif %}
    outputs(row->x, place[row->piece], row->y);
    constraint_forces(row->x, row->tau, row->force);
{% if contacts %}
    friction_use(row->x, row->tau, row->use);
{% endif %}
    say_row(row);
}

/* Moves from a tick to the next, with the commands that begin to act and the rows in between; 1 after the last row. */
static int move(run *self, double end)
{
    while (self->t < end) {
        double last = end;
        while (self->count > 0 && self->waiting[self->first].when <= self->t) {
            self->held[0] = self->waiting[self->first].given[0];
            self->held[1] = self->waiting[self->first].given[1];
            self->first = (self->first + 1) % WAITING;
            self->count--;
        }
        if (self->count > 0 && self->waiting[self->first].when < end) {
            last = self->waiting[self->first].when;
        }
        while (self->t < last) {
            const double row = self->rows < ROWS ? (double)self->rows * OUTPUT_STEP : DURATION;
            const int due = row < last - SLACK;
            const double until = due ? row : last;
            const int status = hold(self->x, self->held, until - self->t);
            self->t = self->t > until ? self->t : until;
            if (status < 0) {
                show(self, status, self->t);
                return status;
            }
            if (due) {
                show(self, NOSLIP_OK, row);
                if (self->rows++ == ROWS) {
                    return 1;
                }
            }
        }
    }
    return 0;
}

int main(void)
{
    static const double start[STATES] = {@{ start | join(", ") }};
    const @{ r("follower_config") } *config = vehicle_config();
    @{ r("follower") } follower;
    run self;
    long k;
    int i, status = @{ r("follower_init") }(&follower, config);
{% for part in columns %}
    say("@{ part }@{ "," if not loop.last }");
{% endfor %}
    say("\n");
    if (status < 0) {
        say(noslip_status_name(status));
        say("\n");
        return 1;
    }
    self.t = 0;
    self.first = self.count = 0;
    self.rows = 0;
    for (i = 0; i < STATES; i++) {
        self.x[i] = start[i];
    }
    for (i = 0; i < 2; i++) {
        self.held[i] = @{ "start[STATES - 2 + i]" if drives else "0" };
    }
{% if noise %}
    self.draws = 0;
    self.sample = 0;
    draw(&self);
    for (i = 0; i < 2; i++) {
        self.before[i] = self.turned[i] = start[i == 0 ? @{ angles[0] } : @{ angles[1] }];
    }
{% endif %}
    for (k = 0; status == NOSLIP_OK; k++) {
        const double end = (double)(k + 1) * PERIOD, latest = end + LATE * PERIOD;
        const double acts = (double)(k + LATE) * PERIOD + LATER;
        self.waiting[(self.first + self.count) % WAITING].when = acts < latest ? acts : latest;
{% if noise %}
        read(&self);
{% endif %}
        status = tick(&self, &follower, config->counter_bits);
        if (status < 0) {
            show(&self, status, self.t);
        } else {
            status = move(&self, end);
        }
    }
    return status < 0;
}
