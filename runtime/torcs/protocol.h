/* What the host robot and whoever drives it say to each other, over one stream socket.

   The host is a TORCS robot that stops on the grid, before anything has moved, and waits there.
   Each REQUEST makes it fork: the child races, the parent stays on the grid. So every race starts
   from the same state. A race that dies takes the parent with it, which says why on its output.

   LOCK_STEP  the child sends a frame, waits for a command, applies it, and so on; the frame with a
              status other than RUNNING is the last.
   NATIVE     the child runs a compiled controller (the library that pirlc builds from emitted C)
              and answers with parts of a trace, each a trace_header and that many frames; the
              last frame of the last part has a status other than RUNNING.
   ROBOT      the same, driven by another robot of TORCS.
   TRACK      the parent itself answers with the edges of the track.

   Both ends run on one machine: structures travel as they are in memory. Hosts and drivers of one
   PIRLC_PROTOCOL understand each other: new members take the place of spare ones, where 0 means
   what was before. */
#ifndef PIRLC_TORCS_PROTOCOL_H
#define PIRLC_TORCS_PROTOCOL_H

#include <stdint.h>

#define PIRLC_PROTOCOL 1
#define PIRLC_READINGS 29
#define PIRLC_ACTIONS 3 /* steer, accel, brake */
#define PIRLC_MOST_PARAMS 256
#define PIRLC_PATH 1024

enum pirlc_request_kind {
    PIRLC_LOCK_STEP = 1,
    PIRLC_NATIVE = 2,
    PIRLC_TRACK = 3,
    PIRLC_ROBOT = 4 /* NATIVE, but another TORCS robot drives */
};

enum pirlc_reward { PIRLC_REWARD_NDPS = 0, PIRLC_REWARD_GYM_TORCS = 1, PIRLC_REWARD_PROGRESS = 2 };

enum pirlc_status {
    PIRLC_RUNNING = 0,
    PIRLC_FINISHED = 1,      /* the laps are done */
    PIRLC_OFF_TRACK = 2,
    PIRLC_TOO_SLOW = 3,
    PIRLC_BACKWARDS = 4,
    PIRLC_OUT = 5,           /* TORCS took the car out: too slow a lap, no fuel, too much damage */
    PIRLC_TIME_LIMIT = 6,    /* a truncation, not an end */
    PIRLC_BAD_ACTION = 7,    /* a command that is not finite; it was not applied */
    PIRLC_NO_CONTROLLER = 8  /* the library could not be loaded */
};

typedef struct {
    uint32_t protocol;
    uint32_t kind;
    uint32_t reward;
    int32_t laps;        /* 0: no end */
    int32_t most_steps;  /* 0: no limit */
    int32_t slow_after;  /* steps after which being slower than `slow` ends the race; < 0: never */
    int32_t backwards;   /* whether driving backwards ends it */
    int32_t parameters;
    int32_t components;  /* of the controller's action: 2 or 3 */
    int32_t beams;       /* 0: the beams are not needed */
    uint32_t blocked;    /* one bit a reading */
    uint32_t part;       /* frames of a trace that are sent at a time; 0: all, at the end */
    uint64_t seed;       /* of blocking and of noise */
    double slow;         /* km/h */
    double off_track;    /* |trackPos| from which on the race ends; infinite: never */
    double block_probability;
    double noise;        /* standard deviation of the readings' relative error */
    double grip;         /* factor on the friction of every surface */
    double params[PIRLC_MOST_PARAMS];
    char library[PIRLC_PATH];
} pirlc_request;

/* All doubles, so that the other side reads frames as one array. */
typedef struct {
    double status;
    double reward;    /* of the step that led here; 0 in the first frame */
    double time;      /* s, from the start signal; negative before it */
    double laps;      /* completed */
    double lap_time;  /* s, of the last completed lap */
    double distance;  /* m along the track, from where the race started */
    double damage;
    double x, y, yaw; /* m, m, rad */
    double to_middle; /* m, left positive */
    double width;     /* m, of the road here */
    double speed;     /* m/s, along the car's axis */
    double gear;      /* engaged */
    double fuel;      /* l */
    double collisions; /* steps so far in which the car touched a wall */
    double invalid;   /* 1 if TORCS does not count the current lap: a wall touched, a corner cut */
    double command[PIRLC_ACTIONS]; /* applied from here on; NaN in a last frame, and in lock-step */
    double readings[PIRLC_READINGS]; /* scaled, as the policy sees them; NaN: blocked */
} pirlc_frame;

typedef struct {
    double steer, accel, brake;
    uint32_t leave; /* not 0: no command, the race is to end */
    uint32_t processor; /* one more than the number of that to run on from now on; 0: any */
} pirlc_command;

typedef struct {
    uint64_t frames;
} pirlc_trace_header;

#endif
