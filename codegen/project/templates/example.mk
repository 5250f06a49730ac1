# make: builds lib@{ robot }.a and the example, and runs it. CC and CFLAGS are yours to set.
# Every dialect from C99 on gives the same bits; -ffast-math does not compile.
CC ?= cc
AR ?= ar
CFLAGS ?= -O2
CFLAGS += @{ standard | join(" ") } -Wall -Wextra
OBJECTS := $(patsubst %.c,%.o,$(filter-out example.c,$(wildcard *.c)))

.PHONY: all clean
all: example
	./example

lib@{ robot }.a: $(OBJECTS)
	$(AR) rcs $@ $(OBJECTS)

example: example.c lib@{ robot }.a
	$(CC) $(CFLAGS) -o $@ example.c lib@{ robot }.a

%.o: %.c $(wildcard *.h *.inc)
	$(CC) $(CFLAGS) -c -o $@ $<

clean:
	rm -f *.o lib@{ robot }.a example
