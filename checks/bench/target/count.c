/*
 * count.c - QEMU plugin: instructions executed per call of some functions, with everything they call.
 *
 * Each argument call=ENTRY:FIRST:LAST (hexadecimal) names a function by its first instruction and the caller by its range:
 * a call lasts from the entry, when it comes right after the caller, until the caller executes again. A function may be
 * named with several callers. An argument cycles=FILE names the file of checks/bench/cycles.py. At exit, a line for each function on the
 * plugin's log, with the cycles of all calls and of the longest, 0 without such a file:
 *     ENTRY calls total least most cycles most_cycles
 */
#include <inttypes.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The part of QEMU's plugin interface, version 1, that is needed; distributions ship no header for it. */
typedef uint64_t qemu_plugin_id_t;
typedef struct qemu_info_t qemu_info_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
enum qemu_plugin_cb_flags { QEMU_PLUGIN_CB_NO_REGS };
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t index);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id,
                                           void (*callback)(qemu_plugin_id_t id, struct qemu_plugin_tb *tb));
void qemu_plugin_register_vcpu_insn_exec_cb(struct qemu_plugin_insn *insn, void (*callback)(unsigned vcpu, void *userdata),
                                            enum qemu_plugin_cb_flags flags, void *userdata);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, void (*callback)(qemu_plugin_id_t id, void *userdata), void *userdata);
void qemu_plugin_outs(const char *text);

#define EXPORT __attribute__((visibility("default")))
#define MOST 128
#define CODE 0x200000 /* bytes of the image whose cycles are estimated, of which the first address is a multiple of this */

typedef struct {
    uint64_t entry, first, last, calls, total, least, most, cycles, most_cycles;
} counted;

EXPORT int qemu_plugin_version = 1;
static counted functions[MOST];
static size_t count;
static counted *running;
static uint64_t executed, cycles, previous;
static unsigned char costs[CODE / 2 + 1]; /* cycles of the instruction at each halfword, 0 where none begins */
static unsigned refill; /* cycles of a branch that is taken, besides its own */

static void instruction(unsigned vcpu, void *userdata)
{
    const uint64_t address = (uint64_t)(uintptr_t)userdata;
    size_t i;
    (void)vcpu;
    if (running != NULL && address >= running->first && address <= running->last) {
        running->calls++;
        running->total += executed;
        cycles += refill; /* the return is a branch */
        running->cycles += cycles;
        running->most_cycles = cycles > running->most_cycles ? cycles : running->most_cycles;
        running->least = running->calls == 1 || executed < running->least ? executed : running->least;
        running->most = executed > running->most ? executed : running->most;
        running = NULL;
    }
    for (i = 0; running == NULL && i < count; i++) {
        if (functions[i].entry == address && previous >= functions[i].first && previous <= functions[i].last) {
            running = &functions[i];
            executed = 0;
            cycles = 0;
        }
    }
    executed++;
    {
        const int follows = address == previous + 2 || (address == previous + 4 && costs[previous % CODE / 2 + 1] == 0);
        cycles += costs[address % CODE / 2] + (follows ? 0 : refill);
    }
    previous = address;
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    size_t i;
    (void)id;
    for (i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        struct qemu_plugin_insn *insn = qemu_plugin_tb_get_insn(tb, i);
        void *address = (void *)(uintptr_t)qemu_plugin_insn_vaddr(insn);
        qemu_plugin_register_vcpu_insn_exec_cb(insn, instruction, QEMU_PLUGIN_CB_NO_REGS, address);
    }
}

static void finish(qemu_plugin_id_t id, void *userdata)
{
    char line[160];
    size_t i;
    (void)id;
    (void)userdata;
    for (i = 0; i < count; i++) {
        const counted *f = &functions[i];
        snprintf(line, sizeof line, "%" PRIx64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 "\n",
                 f->entry, f->calls, f->total, f->least, f->most, f->cycles, f->most_cycles);
        qemu_plugin_outs(line);
    }
}

static int read_costs(const char *name)
{
    FILE *file = fopen(name, "r");
    uint64_t address;
    unsigned number;
    int known;
    if (file == NULL) {
        return 1;
    }
    known = fscanf(file, "%u", &refill) == 1;
    while (known && fscanf(file, "%" SCNx64 " %u", &address, &number) == 2) {
        costs[address % CODE / 2] = (unsigned char)number;
    }
    fclose(file);
    return !known;
}

EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const qemu_info_t *info, int argc, char **argv)
{
    int i;
    (void)info;
    for (i = 0; i < argc && count < MOST; i++) {
        counted *f = &functions[count];
        if (strncmp(argv[i], "cycles=", 7) == 0) {
            if (read_costs(argv[i] + 7) != 0) {
                return 1;
            }
            continue;
        }
        if (sscanf(argv[i], "call=%" SCNx64 ":%" SCNx64 ":%" SCNx64, &f->entry, &f->first, &f->last) != 3) {
            return 1;
        }
        count++;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
