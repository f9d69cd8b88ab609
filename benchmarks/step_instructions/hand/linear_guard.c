#include "linear_guard.h"

#include <math.h>

/* The ranges are those of binary32 readings. */
#define POSITION_MAX 4.800000190734863
#define VELOCITY_MAX 10.0
#define ANGLE_MAX 0.41887903213500977

const hand_params hand_default_params = {3.0, 1.0, 0.0};

void hand_reset(hand_state *s)
{
    s->angle = 0.0;
    s->angular_velocity = 0.0;
    s->position_flags = 0;
    s->velocity_flags = 0;
    s->angle_flags = 0;
    s->angular_velocity_flags = 0;
}

static unsigned char judge(double reading, double limit)
{
    if (!isfinite(reading)) {
        return HAND_MISSING;
    }
    return reading < -limit || reading > limit ? HAND_OUTSIDE : 0u;
}

unsigned hand_step(const hand_params *p, hand_state *s, const hand_observation *in,
                   hand_action *out)
{
    s->position_flags = judge(in->position, POSITION_MAX);
    s->velocity_flags = judge(in->velocity, VELOCITY_MAX);
    s->angle_flags = judge(in->angle, ANGLE_MAX);
    s->angular_velocity_flags = judge(in->angular_velocity, VELOCITY_MAX);
    if (s->angle_flags != HAND_MISSING) {
        s->angle = in->angle;
    }
    if (s->angular_velocity_flags != HAND_MISSING) {
        s->angular_velocity = in->angular_velocity;
    }

    out->push = p->k1 * s->angle + p->k2 * s->angular_velocity > p->c ? 1 : 0;

    return (unsigned)s->position_flags | (unsigned)s->velocity_flags | (unsigned)s->angle_flags |
           (unsigned)s->angular_velocity_flags;
}
