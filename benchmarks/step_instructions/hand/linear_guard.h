/* Written by hand: CartPole's linear guard on pole angle and angular velocity. */
#ifndef HAND_LINEAR_GUARD_H
#define HAND_LINEAR_GUARD_H

#define HAND_MISSING 1u
#define HAND_OUTSIDE 2u
#define HAND_SAFE 4u

typedef struct {
    double position, velocity, angle, angular_velocity;
} hand_observation;

typedef struct {
    int push;
} hand_action;

typedef struct {
    double k1, k2, c;
} hand_params;

typedef struct {
    double angle, angular_velocity; /* last good readings */
    unsigned char position_flags, velocity_flags, angle_flags, angular_velocity_flags;
} hand_state;

extern const hand_params hand_default_params;

void hand_reset(hand_state *s);
unsigned hand_step(const hand_params *p, hand_state *s, const hand_observation *in,
                   hand_action *out);

#endif
