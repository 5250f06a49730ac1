{% set image = "selftest.elf" if board.bare else "selftest.run" %}
# make          the library lib@{ robot }.a, the loop's object, the self-test
# make test     runs the self-test@{ " in QEMU" if board.run else "" }; its exit code is the number of laws that failed
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
OWN := @{ board.own_flags ~ " " if board.own_flags else "" }-ffunction-sections -fdata-sections @{ standard | join(" ") } \
    -Wall -Wextra -Wconversion -Wsign-conversion -Wdouble-promotion -Wfloat-conversion -Wshadow -Wundef -Wvla
OBJECTS := $(patsubst %.c,%.o,$(wildcard noslip/*.c))
START := @{ board.sources | join(" ") }

.PHONY: all test budget clean
.DELETE_ON_ERROR:
all: lib@{ robot }.a loop.o @{ image }

lib@{ robot }.a: $(OBJECTS)
	$(AR) rcs $@ $(OBJECTS)

@{ image }: selftest/selftest.c $(START) lib@{ robot }.a $(wildcard board/* selftest/*.h)
	$(CC) $(OWN) $(CFLAGS) {% for flag in board.define %}@{ flag } {% endfor %}-Inoslip -Iboard -Iselftest \
	    selftest/selftest.c $(START) lib@{ robot }.a @{ board.link | join(" ") or "-Wl,--gc-sections" } -o $@

%.o: %.c $(wildcard noslip/*.h noslip/*.inc)
	$(CC) $(OWN) $(CFLAGS) -Inoslip -fstack-usage -c -o $@ $<

test: @{ image }
	$(RUN)

budget: loop.o lib@{ robot }.a
	@$(CC) $(OWN) -r -nostdlib -Wl,--gc-sections -Wl,-e,control_loop loop.o lib@{ robot }.a -o needed.o
	@echo "what loop.c needs, itself included:"; $(CROSS)size needed.o; rm -f needed.o
	@echo "stack, bytes, of each function by itself:"
	@cat noslip/*.su loop.su | awk -F'[\t:]' '{print "  " $$5, $$4}' | sort -rn | head -6

clean:
	rm -f noslip/*.o noslip/*.su loop.o loop.su lib@{ robot }.a @{ image }
