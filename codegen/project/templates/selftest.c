/*
 * selftest.c - does this processor, with this compiler and these flags, compute what the model says, and the bits that
 * were computed where this was written? Steps every law at some states, wrong ones among them. Compares status and inputs
 * with the model's, found in extended precision and rounded: `within` is how far off tau may be. Then compares a digest
 * (FNV-1a) of all their bits with that of the C where this was written, and leads a vehicle along a path (route.h).
 * Compile it with the flags, and in the dialect, of the files that use the headers: what is inline there is tested here.
 * Tells what a step costs, where something counts: see stopwatch.h.
 */
#include "console.h"
#include "stopwatch.h"
{% for law in laws %}
#include "@{ law.name }.h"
{% endfor %}

#define REAL @{ real }
#define OF(name) name@{ "##" ~ suffix if suffix else "" }
#include "route.h"

typedef @{ "uint32_t" if real == "float" else "uint64_t" } bits;

#define REPEAT 1000u /* steps that are timed */

static uint32_t mixed(uint32_t digest, uint32_t word)
{
    return (digest ^ word) * @{ prime }u;
}

static uint32_t mixed_bits(uint32_t digest, bits value)
{
    return mixed(@{ "digest, value" if real == "float" else "mixed(digest, (uint32_t)value), (uint32_t)(value >> 32)" });
}

{% macro constants(law) %}
    static const @{ own(law.robot ~ "_params") } params = {@{ law.params }};
    static const @{ own(law.prefix ~ "_config") } config = {@{ law.config }};
    static const @{ own(law.prefix ~ "_gains") } gains = {@{ law.gains }};
    static const @{ own(law.robot ~ "_options") } options = {.limit = {@{ law.limits }}, .on_error = NOSLIP_ZERO, .on_limit = @{ "NOSLIP_SLOW" if law.slows else "NOSLIP_CUT" }@{ law.friction }};
{% endmacro %}
{% for law in laws %}
{% set step = own(law.prefix ~ "_step") ~ "(&law, &state.value, &reference.value" ~ (", 0" if law.extension else "") ~ ", tau.value)" %}
/* @{ law.about }. Answers 0 if all is right. */
static int test_@{ law.name }(void)
{
@{ constants(law) }    static const struct {
        bits state[@{ law.state }], @{ "extension[" ~ law.extension ~ "], " if law.extension else "" }reference[@{ law.reference }];
        @{ real } tau[@{ law.inputs }], within;
        int status;
    } steps[] = {
{% for row in law.rows %}
        @{ row },
{% endfor %}
    };
    const unsigned count = sizeof steps / sizeof steps[0];
    union {
        bits given[@{ law.state }];
        @{ own(law.robot ~ "_state") } value;
    } state;
    union {
        bits given[@{ law.reference }];
        @{ own(law.prefix ~ "_reference") } value;
    } reference;
{% if law.extension %}
    union {
        bits given[@{ law.extension }];
        @{ real } value[@{ law.extension }];
    } extension;
{% endif %}
    union {
        @{ real } value[@{ law.inputs }];
        bits made[@{ law.inputs }];
    } tau;
    @{ law.name } law;
    uint32_t cost, digest = @{ offset_basis }u;
    unsigned k, i;
    int wrong = @{ own(law.prefix ~ "_init") }(&law, &params, &config, &gains, &options) != NOSLIP_OK;

    for (k = 0; k < count && !wrong; k++) {
        for (i = 0; i < @{ law.state }u; i++) {
            state.given[i] = steps[k].state[i];
        }
        for (i = 0; i < @{ law.reference }u; i++) {
            reference.given[i] = steps[k].reference[i];
        }
{% if law.extension %}
        for (i = 0; i < @{ law.extension }u; i++) {
            extension.given[i] = steps[k].extension[i];
            law.extension[i] = extension.value[i];
        }
{% endif %}
        const int status = @{ step };
        wrong = status != steps[k].status;
        digest = mixed(digest, (uint32_t)status);
        for (i = 0; i < @{ law.inputs }u; i++) {
            const @{ real } off = tau.value[i] - steps[k].tau[i];
            wrong = wrong || !(off <= steps[k].within && -off <= steps[k].within);
            digest = mixed_bits(digest, tau.made[i]);
        }
    }
    say("@{ law.name }: ");
    if (wrong) {
        say("FAIL at step ");
        say_number(k);
        say(", which is not the model");
    } else if (digest != 0x@{ law.digest }u) {
        wrong = 1;
        say("FAIL, the model, but with other bits than where this was written");
    } else {
        say("pass, steps ");
        say_number(count);
        for (i = 0; i < @{ law.state }u; i++) {
            state.given[i] = steps[0].state[i];
        }
        for (i = 0; i < @{ law.reference }u; i++) {
            reference.given[i] = steps[0].reference[i];
        }
        if (@{ own(law.prefix ~ "_init") }(&law, &params, &config, &gains, NULL) < 0) { /* no limits: it counts a step that is good */
            wrong = 1;
        }
        cost = stopwatch_read();
        for (k = 0; k < REPEAT; k++) {
            (void)@{ step };
        }
        cost = stopwatch_since(cost);
        if (cost > 0) {
            say(", " STOPWATCH_COUNTS " of one ");
            say_number(cost / REPEAT);
        }
    }
    say("\n");
    return wrong;
}

{% endfor %}
{% for law in laws if law.follows %}
static uint32_t follow_@{ law.name }(void)
{
@{ constants(law) }    static const @{ real } given[@{ law.states | length }][@{ law.state }] = {
{% for row in law.states %}
        {@{ row }},
{% endfor %}
    };
    @{ own(law.prefix ~ "_reference") } reference = {@{ law.zeros }};
    @{ law.name } law;
    route on;
    unsigned tick;
    uint32_t digest = (uint32_t)@{ own(law.prefix ~ "_init") }(&law, &params, &config, &gains, &options);
    route_begin(&on);
    for (tick = 0; tick < ROUTE_TICKS; tick++) {
        const @{ own(law.robot ~ "_state") } state = {{% for k in range(law.state) %}given[tick % @{ law.states | length }u][@{ k }]@{ "" if loop.last else ", " }{% endfor %}};
        @{ real } tau[@{ law.inputs }];
        int status;
        route_tick(&on, tick);
        reference.speed = on.path.guide.speed;
        status = @{ own(law.prefix ~ "_follow") }(&law, &on.path.guide.foot, &state, &reference, tau);
        digest = digest_word(digest_reals(digest, tau, @{ law.inputs }), (uint32_t)status);
    }
    return digest;
}

{% endfor %}
/* Returns 0 if a digest is the expected one. */
static int compare(const char *name, uint32_t digest, uint32_t expected)
{
    say(name);
    say(digest == expected ? ": pass\n" : ": FAIL\n");
    return digest != expected;
}

int main(void)
{
    int wrong = 0;
{% for law in laws %}
    wrong += test_@{ law.name }();
{% endfor %}
{% for name, said, value in digests %}
    wrong += compare("@{ said }", @{ name }(), 0x@{ value }u);
{% endfor %}
    say(wrong == 0 ? "selftest: pass\n" : "selftest: FAIL\n");
    return wrong < 100 ? wrong : 100;
}
