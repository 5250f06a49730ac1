/* drive.h - the vehicle of vehicle.c driven along its path, without hardware: the follower, and the robot in place of its wheels. */
#ifndef DRIVE_H
#define DRIVE_H

/* What `noslip simulate` writes in a row, SI; the last two of them only where the SPEC asks for them. */
typedef struct {
    double t;
    double x[@{ state | length }];       /* the true state: @{ state | join(", ") } */
    double tau[@{ inputs | length }];     /* inputs of the robot: @{ inputs | join(", ") } */
    double y[2];       /* true outputs: distance, speed */
    double desired[2];
    double force[@{ forces }];   /* constraint forces, lambda of (8) */
    double seen[@{ state | length }];    /* the state that the follower sees */
    double integral[2];
    double command[2]; /* to velocity drives */
    double believed;   /* friction */
    double use[@{ contacts | length or 1 }];     /* of friction, by each contact */
    int piece;         /* of the path */
    int status;        /* of the follower's law, or its error */
} drive_row;

/* Drives, and gives each row to `take`, with `to`. Returns 0, or 1 where the watchdog stopped the vehicle or an error ended it. */
int drive(void (*take)(const drive_row *row, void *to), void *to);

#endif
