/* Written by hand: the switched PID acceleration over a window of five readings. */
#ifndef HAND_SWITCHED_PID_H
#define HAND_SWITCHED_PID_H

#define HAND_MISSING 1u
#define HAND_OUTSIDE 2u
#define HAND_SAFE 4u

#define HAND_WINDOW 5u

typedef struct {
    double TrackPos, RPM;
} hand_observation;

typedef struct {
    double Accel;
} hand_action;

typedef struct {
    double edge;
    double centre_setpoint, centre_kp, centre_ki, centre_kd;
    double side_setpoint, side_kp, side_ki, side_kd;
} hand_params;

typedef struct {
    double track_pos;        /* last good reading */
    double rpm[HAND_WINDOW]; /* ring buffer; rpm[oldest] is the oldest reading */
    unsigned oldest;
    unsigned char rpm_seen;
    unsigned char track_pos_flags, rpm_flags;
} hand_state;

extern const hand_params hand_default_params;

void hand_reset(hand_state *s);
unsigned hand_step(const hand_params *p, hand_state *s, const hand_observation *in,
                   hand_action *out);

#endif
