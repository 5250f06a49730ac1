/*
 * @{ identifier }.c - for co-simulation by FMI 3.0:
 * @{ about }
{% for line in banner %}
 * @{ line }
{% endfor %}
 *
{% if kind == "controller" %}
 * A communication step calls the law once, with the inputs as they are at its beginning; tau then holds until its end.
{% elif kind == "plant" %}
 * A communication step integrates (11) with constant tau by the method of Runge and Kutta of order 4, in equal steps of at most
 * integration_step.
{% else %}
 * The law is called every `period` from the start of the simulation on; its inputs are held in between, while (11) is integrated
 * by the method of Runge and Kutta of order 4, in equal steps of at most integration_step.
{% endif %}
 * An instance is one block of memory from calloc, which FMI 3.0 leaves to the FMU; there are no variables outside it, so that
 * instances are independent.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "noslip_fmi3.h"
{% if law %}
#include "@{ law }.h"
{% endif %}
{% if dynamics %}
#include "@{ dynamics }.h"
{% endif %}

{% set last = choices | length - 1 %}
enum { REALS = @{ reals | length }, CHOICES = @{ choices | length }, STATUS = @{ last }, COORDINATES = @{ coordinates }, STATES = @{ states } };

/* Value references: 0 to REALS - 1 are numbers, in this order; then CHOICES enumerations. */
typedef union {
    double at[REALS];
    struct {
        double time;
{% for group in groups %}
        @{ group.declaration };
{% endfor %}
    } of;
} reals;

typedef char all_numbers_are_doubles[sizeof(reals) == REALS * sizeof(double) ? 1 : -1];

static const double start_reals[REALS] = {@{ reals | map(attribute="literal") | join(", ") }};
static const fmi3Int64 start_choices[CHOICES] = {@{ choices | map(attribute="literal") | join(", ") }};
static const fmi3Int64 last_choices[CHOICES] = {{% for v in choices %}@{ enumerations[v.declared][-1].value }@{ "" if loop.last else ", " }{% endfor %}};
/* When a value may be set: i, always (inputs); s, before the first step (parameters and starting values); -, never. */
static const char settable[] = "@{ (reals + choices) | map(attribute="settable") | join }";

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED } mode;

typedef struct {
    reals real;
    fmi3Int64 choice[CHOICES];
    mode mode;
{% if kind == "loop" %}
    double begin; /* s: time of the first call of the law */
    double calls; /* of the law */
{% endif %}
{% if extension %}
    double called; /* s: time of the last call of the law */
{% endif %}
{% if law %}
    @{ law } law;
{% endif %}
{% if dynamics %}
    @{ dynamics } dynamics;
{% endif %}
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    fmi3Boolean logging;
} model;

/* Logs "what: why" and returns `status`; warnings are logged only if logging is on. */
static fmi3Status report(const model *self, fmi3Status status, const char *what, const char *why)
{
    char message[200];
    if (self->log != NULL && (self->logging || status > fmi3Warning)) {
        (void)snprintf(message, sizeof message, "%s: %s", what, why);
        self->log(self->environment, status, status > fmi3Warning ? "logStatusError" : "logStatusWarning", message);
    }
    return status;
}

{% if law %}
/* Calls the law@{ ", dt (s) after the last call" if extension }; the status is an output, tau zero or held on an error. */
static fmi3Status call(model *self, @{ law } *law@{ ", double dt" if extension })
{
    const int status = @{ law }_step(law, &self->real.of.state, &self->real.of.reference, @{ "dt, " if extension }self->real.of.tau);
    self->choice[STATUS] = status;
    return status < 0 ? report(self, fmi3Warning, "@{ law }_step", noslip_status_name(status)) : fmi3OK;
}

{% endif %}
{% if dynamics %}
/* Integrates the state for some seconds, with constant tau. */
static fmi3Status advance(model *self, double seconds)
{
    static const double share[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};
    const double exact_steps = seconds / self->real.of.integration_step;
    union {
        double at[STATES];
        @{ robot }_state of;
    } now, tried;
    double steps = 1.0, k;
    int stage, i;
    steps += (double)(int32_t)(exact_steps * (1.0 - 1e-12));
    now.of = self->real.of.state;
    for (k = 0.0; k < steps; k += 1.0) {
        double rate[STATES] = {0.0}, mean[STATES] = {0.0};
        for (stage = 0; stage < 4; stage++) {
            for (i = 0; i < STATES; i++) {
                tried.at[i] = now.at[i] + share[stage] * (seconds / steps) * rate[i];
            }
            const int status = @{ dynamics }_acceleration(&self->dynamics, &tried.of, self->real.of.tau, rate, rate + COORDINATES);
            if (status < 0) {
                self->choice[STATUS] = status;
                return report(self, fmi3Error, "@{ dynamics }_acceleration", noslip_status_name(status));
            }
            for (i = 0; i < STATES; i++) {
                mean[i] += weight[stage] * rate[i];
            }
        }
        for (i = 0; i < STATES; i++) {
            now.at[i] += seconds / steps * mean[i];
        }
    }
    self->real.of.state = now.of;
    return fmi3OK;
}

{% endif %}
/* Initializes from parameters, and computes the outputs as they are before the first step. */
static fmi3Status initialize(model *self)
{
    int status = NOSLIP_OK;
{% for name in empty %}
    const @{ robot if name == "params" else law }_@{ name } @{ name } = {0};
{% endfor %}
{% if law %}
    const @{ robot }_options options = {
        .limit = {@{ limits | join(", ") }},
        .on_error = (noslip_on_error)self->choice[0],
        .on_limit = (noslip_on_limit)self->choice[1],
{% if grips %}
        .friction = self->real.of.friction,
{% endif %}
    };
    @{ law } copy;
    status = @{ law }_init(&self->law, @{ arguments | join(", ") }, &options);
{% endif %}
{% if dynamics %}
    if (status == NOSLIP_OK) {
        status = @{ dynamics }_init(&self->dynamics, @{ arguments[0] });
    }
{% for name in lengths %}
    if (status == NOSLIP_OK && !noslip_is_positive(self->real.of.@{ name })) {
        status = NOSLIP_BAD_PARAMETER;
    }
{% endfor %}
{% endif %}
    self->choice[STATUS] = status;
    if (status != NOSLIP_OK) {
        return report(self, fmi3Error, "the parameters are refused", noslip_status_name(status));
    }
{% if extension %}
    memcpy(self->law.extension, self->real.of.extension, sizeof self->law.extension);
{% endif %}
{% if law %}
    copy = self->law;
    (void)call(self, &copy@{ ", 0.0" if extension });
{% endif %}
    return fmi3OK;
}

/* Whether the instance is in a mode between two; logs it if not. */
static int in_mode(const model *self, mode first, mode last, const char *function)
{
    if (self == NULL) {
        return 0;
    }
    if (self->mode < first || self->mode > last) {
        (void)report(self, fmi3Error, function, "not allowed in this mode");
        return 0;
    }
    return 1;
}

static void set_start(model *self)
{
    memcpy(self->real.at, start_reals, sizeof start_reals);
    memcpy(self->choice, start_choices, sizeof start_choices);
    self->mode = INSTANTIATED;
}

/* Whether values of a type may be read, or written: `first` to `end` are the value references of the type. */
static int may_access(model *self, const fmi3ValueReference references[], size_t count, const void *values, size_t value_count,
    fmi3ValueReference first, fmi3ValueReference end, int writes)
{
    size_t k;
    if (!in_mode(self, INSTANTIATED, writes ? STEPPING : TERMINATED, "get or set")) {
        return 0;
    }
    if (count != value_count || (count > 0 && (references == NULL || values == NULL))) {
        (void)report(self, fmi3Error, "get or set", "there must be one value for each value reference");
        return 0;
    }
    for (k = 0; k < count; k++) {
        if (references[k] < first || references[k] >= end) {
            (void)report(self, fmi3Error, "get or set", "there is no variable of this type with this value reference");
            return 0;
        }
        if (writes && (settable[references[k]] == '-' || (settable[references[k]] == 's' && self->mode == STEPPING))) {
            (void)report(self, fmi3Error, "set", "this variable cannot be set, or not any more");
            return 0;
        }
    }
    if (!writes && self->mode == INITIALIZING) {
        return initialize(self) == fmi3OK;
    }
    return 1;
}

const char *fmi3GetVersion(void)
{
    return "3.0";
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    model *self = instance;
    (void)count;
    (void)categories;
    if (self == NULL) {
        return fmi3Error;
    }
    self->logging = on;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed, const fmi3ValueReference intermediate[],
    size_t intermediates, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    model *self;
    (void)name;
    (void)resources;
    (void)visible;
    (void)eventModeUsed;
    (void)earlyReturnAllowed;
    (void)intermediate;
    (void)intermediates;
    (void)update;
    if (token == NULL || strcmp(token, "@{ token }") != 0) {
        if (log != NULL) {
            log(environment, fmi3Error, "logStatusError", "the instantiation token is not that of modelDescription.xml");
        }
        return NULL;
    }
    self = calloc(1, sizeof *self);
    if (self != NULL) {
        set_start(self);
        self->environment = environment;
        self->log = log;
        self->logging = logging;
    }
    return self;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
    fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    model *self = instance;
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (!in_mode(self, INSTANTIATED, INSTANTIATED, "fmi3EnterInitializationMode")) {
        return fmi3Error;
    }
    self->real.of.time = startTime;
{% if kind == "loop" %}
    self->begin = startTime;
    self->calls = 0.0;
{% endif %}
{% if extension %}
    self->called = startTime;
{% endif %}
    self->mode = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    model *self = instance;
    if (!in_mode(self, INITIALIZING, INITIALIZING, "fmi3ExitInitializationMode") || initialize(self) != fmi3OK) {
        return fmi3Error;
    }
    self->mode = STEPPING;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    model *self = instance;
    if (!in_mode(self, STEPPING, STEPPING, "fmi3Terminate")) {
        return fmi3Error;
    }
    self->mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    if (instance == NULL) {
        return fmi3Error;
    }
    set_start(instance);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count, fmi3Float64 values[],
    size_t valueCount)
{
    model *self = instance;
    size_t k;
    if (!may_access(self, references, count, values, valueCount, 0, REALS, 0)) {
        return fmi3Error;
    }
    for (k = 0; k < count; k++) {
        values[k] = self->real.at[references[k]];
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count, const fmi3Float64 values[],
    size_t valueCount)
{
    model *self = instance;
    size_t k;
    if (!may_access(self, references, count, values, valueCount, 0, REALS, 1)) {
        return fmi3Error;
    }
    for (k = 0; k < count; k++) {
        self->real.at[references[k]] = values[k];
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference references[], size_t count, fmi3Int64 values[],
    size_t valueCount)
{
    model *self = instance;
    size_t k;
    if (!may_access(self, references, count, values, valueCount, REALS, REALS + CHOICES, 0)) {
        return fmi3Error;
    }
    for (k = 0; k < count; k++) {
        values[k] = self->choice[references[k] - REALS];
    }
    return fmi3OK;
}

fmi3Status fmi3SetInt64(fmi3Instance instance, const fmi3ValueReference references[], size_t count, const fmi3Int64 values[],
    size_t valueCount)
{
    model *self = instance;
    size_t k;
    if (!may_access(self, references, count, values, valueCount, REALS, REALS + CHOICES, 1)) {
        return fmi3Error;
    }
    for (k = 0; k < count; k++) {
        if (values[k] < 0 || values[k] > last_choices[references[k] - REALS]) {
            return report(self, fmi3Error, "fmi3SetInt64", "this is not a value of the enumeration");
        }
    }
    for (k = 0; k < count; k++) {
        self->choice[references[k] - REALS] = values[k];
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 duration, fmi3Boolean noSetBefore,
    fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastTime)
{
    model *self = instance;
    fmi3Status status = fmi3OK;
    (void)noSetBefore;
    if (!in_mode(self, STEPPING, STEPPING, "fmi3DoStep")) {
        return fmi3Error;
    }
    if (!noslip_is_finite(time) || !noslip_is_positive(duration)) {
        return report(self, fmi3Error, "fmi3DoStep", "the communication step must be finite and positive");
    }
{% if dynamics %}
{% for name in lengths %}
    if (!(duration / self->real.of.@{ name } < 1e9)) {
        return report(self, fmi3Error, "fmi3DoStep", "the communication step is longer than 1e9 times @{ name }");
    }
{% endfor %}
{% endif %}
{% if kind == "controller" %}
    status = call(self, &self->law@{ ", time - self->called" if extension });
{% if extension %}
    self->called = time;
{% endif %}
{% elif kind == "plant" %}
    status = advance(self, duration);
{% else %}
    const double end = time + duration, period = self->real.of.period, slack = 1e-9 * period;
    double now = time;
    while (end - now > slack && status < fmi3Error) {
        double next = self->begin + self->calls * period;
        fmi3Status moved;
        if (now >= next - slack) {
            self->calls += 1.0;
            next = self->begin + self->calls * period;
            status = call(self, &self->law@{ ", now - self->called" if extension });
{% if extension %}
            self->called = now;
{% endif %}
        }
        next = next < end ? next : end;
        moved = advance(self, next - now);
        status = moved == fmi3OK ? status : moved;
        now = next;
    }
{% endif %}
    if (status < fmi3Error) {
        self->real.of.time = time + duration;
    }
    if (eventHandlingNeeded != NULL) {
        *eventHandlingNeeded = 0;
    }
    if (terminateSimulation != NULL) {
        *terminateSimulation = 0;
    }
    if (earlyReturn != NULL) {
        *earlyReturn = 0;
    }
    if (lastTime != NULL) {
        *lastTime = self->real.of.time;
    }
    return status;
}

/*
 * The functions that FMI 3.0 asks every FMU to have, though they belong to what this one does not offer. They do nothing with their
 * other arguments, which are left out: in the calling conventions of the platforms the caller removes them.
 */
#define NOT_OFFERED(type, function, result) \
    FMI3_EXPORT type function(void); \
    type function(void) \
    { \
        return result; \
    }
{% for name in unused.statuses %}
NOT_OFFERED(fmi3Status, @{ name }, fmi3Error)
{% endfor %}
{% for name in unused.instances %}
NOT_OFFERED(fmi3Instance, @{ name }, NULL)
{% endfor %}
