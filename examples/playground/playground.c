/*
 * playground.c - a robot in closed loop with one of its laws, for the page: the generated C, called every period, and the plant
 * of `noslip simulate`. Order and meaning of all steps are those of `sampled` and `_hold` in simulation/integrate.py, so that the
 * numbers are the same bit for bit. robot.h, which build.py writes, says which robot: its LAWS with their headers, ROBOT(name), its
 * name before another one, how many PARAMETERS, STATES, INPUTS, OUTPUTS and CONTACTS it has, its DEGREES of freedom, which are
 * the rows and columns of Phi, and GRIPS if its laws have NOSLIP_GRIP.
 */
#include "robot.h"
#include "noslip_angle.h"
#include "noslip_path.h"

#define SEGMENTS 200
#define SHORTEST 1e-9      /* s: the integrator's shortest step */
#define HEADINGS 72        /* directions in which the law is tried */

/* All that the page writes and reads, doubles in SI units; build.py tells the page the place of each. Arrays are as long as the
 * largest robot needs. */
typedef struct numbers {
    double law;            /* index in `laws` */
    double believed[18];   /* parameters, as the controller knows them */
    double plant[18];      /* the robot's own */
    double config[6];      /* of the law */
    double gains[6];
    double limit;          /* N m, of each motor; 0: none */
    double mode;           /* noslip_on_limit */
    double mu;             /* friction coefficient of the floor */
    double margin;         /* part of mu in reserve, with NOSLIP_GRIP */
    double offset[9];      /* reference: offset + slope t */
    double slope[9];
    double desired[3];     /* places of the desired outputs in the reference */
    double count;          /* segments of the path; 0: a law without one */
    double closed;         /* 1: its last segment is followed by the first */
    double segments[1000]; /* x, y, heading, curvature, length of each */
    double period;         /* s */
    double tolerance;      /* of the integration */
    double x[10];          /* state: at the start, then now */
    double t;              /* s, since the start */
    double tau[4];         /* N m */
    double y[3];           /* outputs */
    double error[3];       /* y - y_d */
    double status;         /* NOSLIP_... */
    double forces[10];     /* N: of the ground on each contact, along and across */
    double use[5];         /* friction use of each contact; above 1 it would slip */
    double piece;          /* segment that is followed */
    double motion[5];      /* x, y (m) and heading (rad) of the vehicle's point, forward speed (m/s), yaw rate (rad/s) */
    double lines[84];      /* m: x, y of the points that show the robot from above */
    double regular[72];    /* det Phi over the product of its rows' norms, -1 to 1, at headings all around */
} numbers;

static numbers page;
static double sign;        /* of det Phi at the start */
static long calls;
static noslip_segment segments[SEGMENTS];
static noslip_path path;

typedef union { ROBOT(state) named; double at[STATES]; } state;
typedef union { ROBOT(params) named; double at[PARAMETERS]; } parameters;
typedef ROBOT(options) options_of_law;

/* Functions that build.py writes as C. Of state, inputs, parameters, duration and tolerance: the state then and its error
 * (simulation/plant.py). Of state and parameters: `motion` (simulation/guidance.py), and of inputs too the forces
 * and loads of the contacts. Of coordinates and parameters: `lines`. Of parameters: how far the vehicle's point is ahead of the
 * axle. */
int step(const double **arguments, double **results, long long *integers, double *work, int memory);
int motion(const double **arguments, double **results, long long *integers, double *work, int memory);
int ground(const double **arguments, double **results, long long *integers, double *work, int memory);
int lines(const double **arguments, double **results, long long *integers, double *work, int memory);
int ahead(const double **arguments, double **results, long long *integers, double *work, int memory);

numbers *playground_numbers(void);
int playground_start(void);
int playground_step(void);
void playground_headings(void);

static void copy(double *to, const double *from, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        to[i] = from[i];
    }
}

/* What a law does, by the same names for all: `truth` has the plant's parameters. */
typedef struct law {
    int (*init)(const parameters *believed, const parameters *plant, const options_of_law *options);
    int (*step)(const state *now, const double *reference, double tau[INPUTS]);
    int (*decoupling)(const state *now, double Phi[DEGREES][DEGREES]);
    int (*output)(const state *now, double h[OUTPUTS]);
    int heading;           /* place of a desired heading in the reference; 0: none */
} law;

#define LAW(name, heading) \
    static ROBOT(name) name##_law, name##_truth; \
    static int name##_init(const parameters *believed, const parameters *plant, const options_of_law *options) \
    { \
        union { ROBOT(name##_config) named; double at[6]; } config; \
        union { ROBOT(name##_gains) named; double at[6]; } gains; \
        int status; \
        copy(config.at, page.config, 6); \
        copy(gains.at, page.gains, 6); \
        status = ROBOT(name##_init)(&name##_law, &believed->named, &config.named, &gains.named, options); \
        return status < 0 ? status \
                          : ROBOT(name##_init)(&name##_truth, &plant->named, &config.named, &gains.named, NULL); \
    } \
    static int name##_step(const state *now, const double *reference, double tau[INPUTS]) \
    { \
        union { ROBOT(name##_reference) named; double at[9]; } wanted; \
        copy(wanted.at, reference, 9); \
        return ROBOT(name##_step)(&name##_law, &now->named, &wanted.named, tau); \
    } \
    static int name##_decoupling(const state *now, double Phi[DEGREES][DEGREES]) \
    { \
        return ROBOT(name##_decoupling)(&name##_law, &now->named, Phi); \
    } \
    static int name##_output(const state *now, double h[OUTPUTS]) \
    { \
        return ROBOT(name##_output)(&name##_truth, &now->named, h); \
    }

#define ENTRY(name, heading) {name##_init, name##_step, name##_decoupling, name##_output, heading},

LAWS(LAW)
static const law laws[] = {LAWS(ENTRY)};

static const law *chosen(void)
{
    return &laws[(int)page.law];
}

static double determinant(double Phi[DEGREES][DEGREES])
{
#if DEGREES == 3
    return Phi[0][0] * (Phi[1][1] * Phi[2][2] - Phi[1][2] * Phi[2][1])
         - Phi[0][1] * (Phi[1][0] * Phi[2][2] - Phi[1][2] * Phi[2][0])
         + Phi[0][2] * (Phi[1][0] * Phi[2][1] - Phi[1][1] * Phi[2][0]);
#else
    return Phi[0][0] * Phi[1][1] - Phi[0][1] * Phi[1][0];
#endif
}

/* Positive unless the singular set has been crossed since the start; 0 where Phi is undefined. */
static double side(const double *x)
{
    double Phi[DEGREES][DEGREES];
    state now;
    copy(now.at, x, STATES);
    if (chosen()->decoupling(&now, Phi) < 0) {
        return 0;
    }
    return sign * determinant(Phi);
}

/* Initializes the law with the numbers of the page. */
static int make_law(void)
{
    parameters believed, plant;
    options_of_law options = {0};
    double found;
    int i, status;
    copy(believed.at, page.believed, PARAMETERS);
    copy(plant.at, page.plant, PARAMETERS);
    for (i = 0; i < INPUTS; i++) {
        options.limit[i] = page.limit;
    }
    options.on_limit = (noslip_on_limit)page.mode;
#ifdef GRIPS
    if (options.on_limit == NOSLIP_GRIP) {
        options.friction.mu = page.mu;
        options.friction.margin = page.margin;
        options.friction.share = 1;
        options.friction.period = page.period;
    }
#endif
    status = chosen()->init(&believed, &plant, &options);
    if (status == NOSLIP_OK) {
        sign = 1;
        found = side(page.x);
        sign = found > 0 ? 1 : -1;
    }
    return status;
}

/* What the controller and the page see of the vehicle. */
static void look(void)
{
    const double *arguments[2] = {page.x, page.believed};
    double *results[1] = {page.motion};
    (void)motion(arguments, results, NULL, NULL, 0);
    arguments[1] = page.plant;
    results[0] = page.lines;
    (void)lines(arguments, results, NULL, NULL, 0);
}

/* Forces of the ground and friction use with the torques of now. */
static void measure_forces(void)
{
    const double *arguments[3] = {page.x, page.tau, page.plant};
    double mass[CONTACTS];
    double *results[2] = {page.forces, mass};
    int i;
    (void)ground(arguments, results, NULL, NULL, 0);
    for (i = 0; i < CONTACTS; i++) {
        const double along = page.forces[2 * i], across = page.forces[2 * i + 1];
        page.use[i] = noslip_sqrt(along * along + across * across) / (page.mu * GRAVITY * mass[i]);
    }
}

/* Updates the path; the law is initialized for each of its segments. Writes the desired speed and its rate. */
static int follow(double *reference)
{
    noslip_guide guide;
    int status = noslip_path_update(&path, page.motion[0], page.motion[1], page.motion[2], page.motion[3], &guide);
    if (status >= 0) {
        reference[3] = guide.speed;
        reference[4] = guide.speed_rate;
        page.piece = guide.segment;
        if (guide.changed) {
            page.config[1] = guide.x;
            page.config[2] = guide.y;
            page.config[3] = guide.heading;
            page.config[4] = guide.curvature;
            return make_law();
        }
    }
    return status;
}

/* Calls the controller: torques, outputs, friction use. */
static int call(void)
{
    const law *const self = chosen();
    double reference[9];
    state now;
    int i, status = NOSLIP_OK;
    for (i = 0; i < 9; i++) {
        reference[i] = page.offset[i] + page.slope[i] * page.t;
    }
    copy(now.at, page.x, STATES);
    look();
    if (page.count > 0) {
        status = follow(reference);
    } else if (self->heading) {
        status = noslip_nearest_angle(reference[self->heading], page.motion[2], &reference[self->heading]);
    }
    if (status >= 0) {
        status = self->step(&now, reference, page.tau);
    }
    if (status >= 0 && !(side(page.x) > 0)) {
        status = NOSLIP_SINGULAR;
    }
    if (status < 0) {
        for (i = 0; i < INPUTS; i++) {
            page.tau[i] = 0;
        }
    }
    if (self->output(&now, page.y) >= 0) {
        for (i = 0; i < OUTPUTS; i++) {
            page.error[i] = page.y[i] - reference[(int)page.desired[i]];
        }
    }
    measure_forces();
    page.status = status;
    return status;
}

/* Factor by which the next step of the integrator is longer, given the norm of this one's error. */
static double resize(double error)
{
    const double factor = error > 0 ? 0.9 / noslip_sqrt(noslip_sqrt(noslip_sqrt(error))) : 10;
    return factor > 10 ? 10 : factor > 0.2 ? factor : 0.2;
}

/* Moves the plant for some seconds, with the torques held. */
static int hold(double duration)
{
    double left = duration, h = duration, after[STATES], error;
    while (left > 0) {
        const double *arguments[5] = {page.x, page.tau, page.plant, &h, &page.tolerance};
        double *results[2] = {after, &error};
        h = h < left ? h : left;
        (void)step(arguments, results, NULL, NULL, 0);
        if (!(error <= 1)) {
            if (h <= SHORTEST) {
                return NOSLIP_NONFINITE;
            }
            h *= resize(error);
            continue;
        }
        if (!(side(after) > 0)) {
            return NOSLIP_SINGULAR;
        }
        copy(page.x, after, STATES);
        left -= h;
    }
    return NOSLIP_OK;
}

numbers *playground_numbers(void)
{
    return &page;
}

/* Starts a run in the state x. Returns the status of the first call. */
int playground_start(void)
{
    int i, status = NOSLIP_OK;
    calls = 0;
    page.t = page.piece = 0;
    if (page.count > 0) {
        noslip_path_options options = {0};
        const double *arguments[1] = {page.believed};
        double *results[1] = {&options.ahead};
        (void)ahead(arguments, results, NULL, NULL, 0);
        options.speed = page.offset[3];
        options.L[0] = page.config[0];
        options.L[1] = -page.config[0] - 2 * options.ahead;
        options.closed = page.closed > 0;
        for (i = 0; i < (int)page.count; i++) {
            const double *const given = page.segments + 5 * i;
            const noslip_segment segment = {given[0], given[1], given[2], given[3], given[4], 0};
            segments[i] = segment;
        }
        status = noslip_path_init(&path, segments, (int)page.count, &options, NULL);
    } else {
        status = make_law();
    }
    if (status < 0) {
        page.status = status;
        return status;
    }
    return call();
}

/* Goes on to the next call of the controller. Returns its status. */
int playground_step(void)
{
    const double next = (double)(calls + 1) * page.period;
    const int status = hold(next - page.t);
    if (status < 0) {
        page.status = status;
        return status;
    }
    calls++;
    page.t = next;
    return call();
}

/* Writes `regular`: how far from singular the law is with the robot turned about its first coordinates, in steps of 5 degrees. */
void playground_headings(void)
{
    int i, j, k;
    for (i = 0; i < HEADINGS; i++) {
        double Phi[DEGREES][DEGREES], scale = 1;
        state now;
        copy(now.at, page.x, STATES);
        now.at[2] = i * 6.283185307179586 / HEADINGS;
        page.regular[i] = 0;
        if (chosen()->decoupling(&now, Phi) >= 0) {
            for (j = 0; j < DEGREES; j++) {
                double square = 0;
                for (k = 0; k < DEGREES; k++) {
                    square += Phi[j][k] * Phi[j][k];
                }
                scale *= noslip_sqrt(square);
            }
            page.regular[i] = scale > 0 ? determinant(Phi) / scale : 0;
        }
    }
}
