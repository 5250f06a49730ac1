{# The source of a law: what checks arguments, limits inputs and answers; `law` is a LawC, which prints the mathematics. #}
{% macro n(name) %}@{ own("noslip_" ~ name) }{% endmacro %}
{% macro f(name) %}@{ law.function(name) }{% endmacro %}
{% macro present(names) %}@{ names | join(" != NULL && ") } != NULL{% endmacro %}
{% macro apply(inputs, answer) %}
@{ n("apply_limits") }(status, self->on_error, self->limit, self->held, @{ inputs }, @{ answer }, @{ count })
{%- endmacro %}
{% macro of_contact(forces, k) %}@{ "&%s[%d]" % (forces, 4 * k) if k else forces }{% endmacro %}
{% macro mathematics(entry) %}
@{ law.storage(entry) } int @{ f(entry.name) }_law(@{ law.parameters(entry).values() | join(", ") })
{
    @{ law.statements_of(entry) | join("\n") | indent }
    return NOSLIP_OK;
}
{%- endmacro %}
{# Whether the inputs made keep every contact within friction; computes `ground`. #}
{% macro rolls() %}
@{ f(ground.name) }_law(self, state, made, ground) == NOSLIP_OK
{%- for k in range(contacts) %} && @{ n("holds") }(@{ of_contact("ground", k) }, &self->grip){% endfor %}
{% endmacro %}
{% macro ground_memory() %}
{% if wheels %}
@{ real } *const ground = self->ground;
{%- else %}
@{ real } ground[@{ 4 * contacts }];
{%- endif %}
{% endmacro %}
{% macro keep_grip() %}
{% set along = "slope" if law.slows else "NULL" %}
{% if law.plain_grip %}
@{ n("keep_grip") }(made, @{ along }, ground, by_inputs[0], &self->grip, self->limit, @{ contacts }, work)
{%- else %}
@{ n("keep_grip_of") }(made, @{ along }, @{ "null_inputs[0]" if law.shapes else "NULL" }, ground, by_inputs[0], &self->grip, self->limit, @{ contacts }, @{ count }, work)
{%- endif %}
{% endmacro %}
{# Keeps what the inputs made, with the forces `ground`, let the wheels do; `memory`: for 3 numbers for each wheel. #}
{% macro expect(memory) %}
if (self->earned.period > 0) {
{% if memory == "drive" %}
    @{ real } drive[@{ 3 * wheels }];
{% endif %}
    if (@{ f(of_wheels.name) }_law(self, state, made, @{ memory }) == NOSLIP_OK) {
{% for k, contact in driven %}
        @{ n("expect") }(&self->wheel[@{ k }], &ground[@{ 4 * contact }], &@{ memory }[@{ 3 * k }]);
{% endfor %}
    }
}
{%- endmacro %}
@{ head }

{% if wheels %}
@{ law.about(of_wheels) }
@{ mathematics(of_wheels) }

{% endif %}
NOSLIP_SMALL @{ law.init_signature() }
{
    int status;
    if (self == NULL) {
        return NOSLIP_NULL;
    }
    self->ready = 0;
    if (config == NULL || gains == NULL) {
        return NOSLIP_NULL;
    }
    status = @{ own(law.robot ~ "_check_params") }(params);
    if (status != NOSLIP_OK) {
        return status;
    }
    if (@{ refuse("config", law.law.config) } ||
        @{ refuse("gains", law.law.gains) }) {
        return NOSLIP_BAD_PARAMETER;
    }
    status = @{ f("reset") }(self);
    if (options != NULL && (!@{ n("limits_ok") }(options->limit, @{ count }) ||
        (options->on_error != NOSLIP_ZERO && options->on_error != NOSLIP_HOLD) ||
{% if law.grips %}
        (options->on_limit != @{ law.on_limit | join(" && options->on_limit != ") }) ||
        (options->on_limit == NOSLIP_GRIP && !@{ n("friction_ok") }(&options->friction, @{ wide })))) {
{% else %}
        (options->on_limit != @{ law.on_limit | join(" && options->on_limit != ") }))) {
{% endif %}
        return NOSLIP_BAD_PARAMETER;
    }
{% for k in range(count) %}
    self->limit[@{ k }] = @{ n("limit") }(options != NULL ? options->limit[@{ k }] : 0);
{% endfor %}
    self->on_error = options != NULL ? options->on_error : NOSLIP_ZERO;
{% if law.on_limit | length > 1 %}
    self->on_limit = options != NULL ? options->on_limit : NOSLIP_CUT;
{% endif %}
{% if law.grips %}
{% for k in range(count) %}
    self->clear[@{ k }] = self->on_limit == NOSLIP_GRIP ? -1 : self->limit[@{ k }];
{% endfor %}
    @{ n("grip_init") }(&self->earned, &self->grip, self->on_limit == NOSLIP_GRIP ? &options->friction : NULL, @{ wheels });
{% endif %}
    @{ computed | join("\n") | indent }
{% if constants %}
    if (!@{ n("is_finite") }(@{ constants | join(" + ") })) {
        return NOSLIP_BAD_PARAMETER;
    }
{% endif %}
{% if wheels %}
    if (status == NOSLIP_OK) {
        static const @{ real } none[@{ count }] = {@{ (["0"] * count) | join(", ") }};
        @{ real } drive[@{ 3 * wheels }];
        status = @{ f(of_wheels.name) }_law(self, NULL, none, drive);
{% for k in range(wheels) %}
        @{ n("wheel_init") }(&self->wheel[@{ k }], &drive[@{ 3 * k }], &self->earned);
{% endfor %}
    }
    @{ n("write_zeros") }(self->ground, @{ 4 * contacts });
{% endif %}
    self->ready = NOSLIP_READY;
    return status;
}

NOSLIP_SMALL int @{ f("reset") }(@{ law.type } *self)
{
    if (self == NULL) {
        return NOSLIP_NULL;
    }
{% for k in range(count) %}
    self->held[@{ k }] = 0;
{% endfor %}
{% if wheels %}
    @{ n("expect_nothing") }(&self->earned);
{% endif %}
{% for k in range(extends) %}
    self->extension[@{ k }] = 0;
    self->extension_rate[@{ k }] = 0;
{% endfor %}
    return NOSLIP_OK;
}

NOSLIP_SMALL @{ law.set_limits_signature() }
{
    if (self == NULL || limit == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    if (!@{ n("limits_ok") }(limit, @{ count })) {
        return NOSLIP_BAD_PARAMETER;
    }
{% for k in range(count) %}
    self->limit[@{ k }] = @{ n("limit") }(limit[@{ k }]);
{% endfor %}
{% if law.grips %}
{% for k in range(count) %}
    self->clear[@{ k }] = self->on_limit == NOSLIP_GRIP ? -1 : self->limit[@{ k }];
{% endfor %}
{% endif %}
{% for k in range(count) %}
    self->held[@{ k }] = @{ n("clip") }(self->held[@{ k }], self->limit[@{ k }]);
{% endfor %}
    return NOSLIP_OK;
}

NOSLIP_SMALL @{ law.update_signature() }
{
    @{ real } held[@{ count }];
{% if extends %}
    @{ real } extension[@{ extends }];
    @{ real } extension_rate[@{ extends }];
{% endif %}
{% if wheels %}
    @{ n("wheel") } wheel[@{ wheels }];
    @{ real } mu, pause, ground[@{ 4 * contacts }];
{% endif %}
    if (self == NULL || next == NULL) {
        return NOSLIP_NULL;
    }
    if (self->ready != NOSLIP_READY || next->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
{% for k in range(count) %}
    held[@{ k }] = self->held[@{ k }];
{% endfor %}
{% for name in ("extension", "extension_rate") %}
{% for k in range(extends) %}
    @{ name }[@{ k }] = self->@{ name }[@{ k }];
{% endfor %}
{% endfor %}
{% if wheels %}
    mu = self->earned.mu;
    pause = self->earned.pause;
    noslip_copy(wheel, self->wheel, sizeof wheel);
    noslip_copy(ground, self->ground, sizeof ground);
{% endif %}
    noslip_copy(self, next, sizeof *self);
{% if wheels %}
    @{ n("believe") }(&self->earned, &self->grip, self->earned.period > 0 ? mu : self->earned.most);
    self->earned.pause = pause;
{% for k in range(wheels) %}
    @{ n("wheel_continue") }(&self->wheel[@{ k }], &wheel[@{ k }]);
{% endfor %}
    noslip_copy(self->ground, ground, sizeof ground);
{% endif %}
{% for k in range(count) %}
    self->held[@{ k }] = @{ n("clip") }(held[@{ k }], self->limit[@{ k }]);
{% endfor %}
{% for name in ("extension", "extension_rate") %}
{% for k in range(extends) %}
    self->@{ name }[@{ k }] = @{ name }[@{ k }];
{% endfor %}
{% endfor %}
    return NOSLIP_OK;
}

{% for admission in law.admissions() %}
static int @{ f(admission.name) }(@{ admission.declared | join(", ") })
{
    if (self->ready != NOSLIP_READY) {
        return NOSLIP_NOT_READY;
    }
    /* A sum is finite only if all its parts are; one that overflows is looked at part by part. */
    if (!@{ n("is_finite") }(@{ admission.read | join(" + ") }) && @{ admission.refused }) {
        return NOSLIP_NONFINITE;
    }
{% if admission.in_range %}
    return @{ admission.in_range | join(" && ") } ? NOSLIP_OK : NOSLIP_RANGE;
{% else %}
    return NOSLIP_OK;
{% endif %}
}

{% endfor %}
{% for entry in law.entries if not entry.public and entry != of_wheels %}
@{ law.about(entry) }
@{ mathematics(entry) }

{% endfor %}
{% for entry in law.entries if entry.public %}
@{ mathematics(entry) }

{% set names = law.arguments(entry) %}
{% set given, answer = names[:-1], names[-1] %}
{% set admitted = law.admission(entry) %}
{% set declared = law.parameters(entry, True) %}
{% if not entry.slope %}
NOSLIP_SMALL @{ law.signature(entry) }
{
{% if not entry.whole %}
    @{ law.local_array(entry) };
{% endif %}
    int status = NOSLIP_NULL;
    if (@{ answer } == NULL) {
        return NOSLIP_NULL;
    }
    if (@{ present(given) }) {
        status = @{ admitted };
    }
{% if entry.takes in arrays %}
    if (status == NOSLIP_OK && !@{ n("all_finite") }(@{ arrays[entry.takes] })) {
        status = NOSLIP_NONFINITE;
    }
{% endif %}
    @{ law.answers(entry) | join("\n") | indent }
}
{% elif extends %}
@{ law.signature(entry) }
{
    @{ real } made[@{ count }] = {@{ (["0"] * count) | join(", ") }};
    @{ real } rate[@{ extends }] = {@{ (["0"] * extends) | join(", ") }};
    int status = NOSLIP_NULL;
    if (tau == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        @{ n("write_zeros") }(tau, @{ count });
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (@{ present(declared | reject("in", ("self", "dt", "tau")) | list) }) {
        status = @{ admitted };
    }
    if (status == NOSLIP_OK && !@{ n("is_finite") }(dt)) {
        status = NOSLIP_NONFINITE;
    }
    if (status == NOSLIP_OK && dt < 0) {
        status = NOSLIP_BAD_PARAMETER;
    }
    if (status == NOSLIP_OK) {
{% for k in range(extends) %}
        self->extension[@{ k }] += dt * self->extension_rate[@{ k }];
{% endfor %}
        status = @{ f(entry.name) }_law(@{ given | map("replace", extension_rate, "rate") | join(", ") }, made);
    }
    if (status == NOSLIP_OK && !(@{ n("all_finite") }(rate, @{ extends }) && @{ n("all_finite") }(self->extension, @{ extends }))) {
        status = NOSLIP_NONFINITE;
    }
    status = @{ apply("made", "tau") };
{% for k in range(extends) %}
    self->extension_rate[@{ k }] = status == NOSLIP_OK ? rate[@{ k }] : 0;
{% endfor %}
    return status;
}
{% else %}
{# First the common case, with fewer checks that are sufficient there; else functions for inputs beyond a limit, and for errors. #}
{% set before, after = law.ordinary(entry) %}
{% set passed = law.passed(entry) %}
{% set limited = law.limited_parameters(entry) %}
{% set slope = law.arguments(entry.slope) | join(", ") if law.slows else "" %}
/* The step when something is wrong: finds out what. */
static NOSLIP_BESIDE int @{ f(entry.name) }_refused(@{ declared.values() | join(", ") }, int status)
{
    if (@{ answer } == NULL) {
        return NOSLIP_NULL;
    }
    if (self == NULL || self->ready != NOSLIP_READY) {
        @{ n("write_zeros") }(@{ answer }, @{ count });
        return self == NULL ? NOSLIP_NULL : NOSLIP_NOT_READY;
    }
    if (@{ present(given[1:]) }) {
        const int admitted = @{ admitted };
        status = admitted == NOSLIP_OK ? status : admitted;
    }
{% if wheels %}
    @{ n("expect_nothing") }(&self->earned);
{% endif %}
    return @{ apply("self->held", answer) };
}

/* The step with inputs that are not finite, or beyond a limit. */
static NOSLIP_COLD int @{ f(entry.name) }_limited(@{ limited | join(", ") })
{
    @{ real } made[@{ count }] = {@{ by_value | join(", ") }};
{% set lines %}
    int status = @{ law.finite(entry) | join(" && ") } ? NOSLIP_OK : NOSLIP_NONFINITE;
{% if law.slows %}
    if (status == NOSLIP_OK && self->on_limit == NOSLIP_SLOW) {
        @{ real } slope[@{ count }];
        status = @{ f(entry.slope.name) }_law(@{ slope });
        if (status == NOSLIP_OK) {
            status = @{ n("slow") }(made, slope, self->limit, @{ count });
        }
    }
{% endif %}
{% if law.grips %}
    if (status == NOSLIP_OK && self->on_limit == NOSLIP_GRIP) {
        @{ ground_memory() }
        @{ real } by_inputs[@{ 3 * contacts }][@{ count }];
{% if law.slows %}
        @{ real } slope[@{ count }];
{% endif %}
        @{ real } work[@{ 3 * contacts + (0 if law.plain_grip else count * (count + 3)) }];
{% if law.shapes %}
        @{ real } null_inputs[@{ count }][@{ count }];
{% endif %}
        status = @{ f(ground.name) }_law(self, state, made, ground);
        status = status == NOSLIP_OK ? @{ f(ground_by_inputs.name) }_law(self, state, by_inputs) : status;
{% if law.slows %}
        status = status == NOSLIP_OK ? @{ f(entry.slope.name) }_law(@{ slope }) : status;
{% endif %}
{% if law.shapes %}
        status = status == NOSLIP_OK ? @{ f(null_inputs.name) }_law(self, state, null_inputs) : status;
{% endif %}
        if (status == NOSLIP_OK) {
            status = @{ keep_grip() } && @{ rolls() } ? NOSLIP_GRIP_LIMITED : NOSLIP_WILL_SLIP;
{% if wheels %}
            @{ expect("work") | indent(12) }
{% endif %}
        }
    }
{% endif %}
    return @{ apply("made", answer) };
{% endset %}
{% for one in passed if not mentioned(one, lines) %}
    (void)@{ one };
{% endfor %}
@{ lines }}

{% if law.grips %}
/* The step with NOSLIP_GRIP: is each contact within friction? */
static NOSLIP_BESIDE int @{ f(entry.name) }_with_grip(@{ limited | join(", ") })
{
    const @{ real } made[@{ count }] = {@{ by_value | join(", ") }};
    @{ ground_memory() }
{% if wheels %}
    if (self->earned.period > 0) {
        const @{ real } rates[@{ wheels }] = {@{ law.rates_of_wheels() | join(", ") }};
        @{ n("earn") }(&self->earned, &self->grip, self->wheel, @{ of_contact("self->ground", first) }, rates, @{ wheels });
    }
{% endif %}
    if (@{ (law.within("limit") + after[count:] + [rolls()]) | join(" && ") }) {
{% if wheels %}
        @{ expect("drive") | indent(8) }
{% endif %}
{% for k in range(count) %}
        @{ answer }[@{ k }] = made[@{ k }];
        self->held[@{ k }] = made[@{ k }];
{% endfor %}
        return NOSLIP_OK;
    }
    return @{ f(entry.name) }_limited(@{ (passed + by_value) | join(", ") });
}

{% endif %}
@{ law.signature(entry) }
{
    @{ real } made[@{ count }];
    int status = NOSLIP_NULL;
    if (@{ present(names) } && @{ before | join(" && ") }) {
        status = @{ f(entry.name) }_law(@{ given | join(", ") }, made);
        /* Any other input that is not finite shows in the result. */
        if (status == NOSLIP_OK && @{ after | join(" && ") }) {
{% for k in range(count) %}
            @{ answer }[@{ k }] = made[@{ k }];
            self->held[@{ k }] = made[@{ k }];
{% endfor %}
            return NOSLIP_OK;
        }
        if (status == NOSLIP_OK) {
            return @{ f(entry.name) }_@{ "with_grip" if law.grips else "limited" }(@{ passed | join(", ") }, @{ made | join(", ") });
        }
    }
    return @{ f(entry.name) }_refused(@{ names | join(", ") }, status);
}
{% endif %}
{% if not loop.last %}

{% endif %}
{% endfor %}
