{% set image = "selftest.elf" if board.bare else "selftest.run" %}
# make          the library lib@{ robot }.a, the loop's object, the self-test
# make test     runs the self-test@{ " in QEMU" if board.run else "" }; its exit code is the number of laws that failed
{% if drives %}
#               and drives the vehicle of vehicle.c along its path: build/run.csv
{% endif %}
# make budget   bytes of code and data that loop.c needs, and of stack by function
# CC, CFLAGS and RUN are yours to set. Every dialect from C99 on gives the same bits; -ffast-math does not compile. The self-test
# tells whether your flags do: make clean test CFLAGS='...'
CROSS ?= @{ board.prefix }
ifeq ($(origin CC),default)
CC := $(CROSS)@{ "gcc" if board.bare else "cc" }
endif
ifeq ($(origin AR),default)
AR := $(CROSS)ar
endif
CFLAGS ?= -O2
RUN ?= @{ (board.run | join(" ")) ~ " " ~ image ~ " < /dev/null" if board.run else "./" ~ image }
{% if drives %}
{% set drive = "drive.elf" if board.bare else "drive.run" %}
DRIVE ?= @{ (board.run | join(" ")) ~ " " ~ drive ~ " < /dev/null" if board.run else "./" ~ drive }
{% endif %}
OWN := @{ board.own_flags ~ " " if board.own_flags else "" }-ffunction-sections -fdata-sections @{ standard | join(" ") } \
    -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Wfloat-conversion -Wshadow -Wundef -Wvla
OBJECTS := $(patsubst %.c,%.o,$(wildcard noslip/*.c))
START := @{ board.sources | join(" ") }

.PHONY: all test budget clean
.DELETE_ON_ERROR:
all: lib@{ robot }.a loop.o @{ image }

lib@{ robot }.a: $(OBJECTS)
	$(AR) rcs $@ $(OBJECTS)

{% for program, source in ([(image, "selftest")] + ([(drive, "drive")] if drives else [])) %}
@{ program }: selftest/@{ source }.c@{ " vehicle.c" if source == "drive" } $(START) lib@{ robot }.a $(wildcard board/* selftest/*.h)
	$(CC) $(OWN) $(CFLAGS) {% for flag in board.define %}@{ flag } {% endfor %}-Inoslip -Iboard -Iselftest \
	    @{ "-I. " if source == "drive" }selftest/@{ source }.c@{ " vehicle.c" if source == "drive" } $(START) lib@{ robot }.a @{ board.link | join(" ") or "-Wl,--gc-sections" } -o $@

{% endfor %}

%.o: %.c $(wildcard noslip/*.h noslip/*.inc)
	$(CC) $(OWN) $(CFLAGS) -Inoslip -fstack-usage -c -o $@ $<

test: @{ image }@{ " " ~ drive if drives }
	$(RUN)
{% if drives %}
	@mkdir -p build
	$(DRIVE) > build/run.csv || { tail -n 1 build/run.csv; exit 1; }
	@echo "build/run.csv: the vehicle along its path, to t = $$(tail -n 1 build/run.csv | cut -d , -f 1) s"
{% endif %}

budget: loop.o@{ " vehicle.o" if drives } lib@{ robot }.a
	@$(CC) $(OWN) -r -nostdlib -Wl,--gc-sections -Wl,-e,control_loop loop.o@{ " vehicle.o" if drives } lib@{ robot }.a -o needed.o
	@echo "what loop.c needs, itself included:"; $(CROSS)size needed.o; rm -f needed.o
	@echo "stack, bytes, of each function by itself:"
	@cat noslip/*.su loop.su | awk -F'[\t:]' '{print "  " $$5, $$4}' | sort -rn | head -6

clean:
	rm -rf noslip/*.o noslip/*.su *.o *.su lib@{ robot }.a @{ image }@{ " " ~ drive ~ " build" if drives }
