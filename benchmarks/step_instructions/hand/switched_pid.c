#include "switched_pid.h"

#include <math.h>

const hand_params hand_default_params = {0.001, 0.44, 3.97, 0.01, 48.79, 0.40, 3.97, 0.01, 48.79};

void hand_reset(hand_state *s)
{
    unsigned i;

    s->track_pos = 0.0;
    for (i = 0; i < HAND_WINDOW; i++) {
        s->rpm[i] = 0.5;
    }
    s->oldest = 0;
    s->rpm_seen = 0;
    s->track_pos_flags = 0;
    s->rpm_flags = 0;
}

unsigned hand_step(const hand_params *p, hand_state *s, const hand_observation *in,
                   hand_action *out)
{
    unsigned status = 0;
    unsigned i, j, newest, before;
    double track_pos = in->TrackPos;
    double rpm = in->RPM;
    double setpoint, kp, ki, kd, sum, accel;

    /* take in the readings */
    s->track_pos_flags = 0;
    if (!isfinite(track_pos)) {
        s->track_pos_flags = HAND_MISSING;
        track_pos = s->track_pos;
    } else if (track_pos < -1.0 || track_pos > 1.0) {
        s->track_pos_flags = HAND_OUTSIDE;
    }
    s->track_pos = track_pos;

    s->rpm_flags = 0;
    newest = s->oldest;
    before = newest == 0 ? HAND_WINDOW - 1 : newest - 1;
    if (!isfinite(rpm)) {
        s->rpm_flags = HAND_MISSING;
        rpm = s->rpm[before];
    } else {
        if (rpm < 0.0 || rpm > 1.0) {
            s->rpm_flags = HAND_OUTSIDE;
        }
        if (!s->rpm_seen) {
            s->rpm_seen = 1;
            for (i = 0; i < HAND_WINDOW; i++) {
                s->rpm[i] = rpm;
            }
        }
    }
    s->rpm[newest] = rpm;
    s->oldest = newest == HAND_WINDOW - 1 ? 0 : newest + 1;
    status = (unsigned)s->track_pos_flags | (unsigned)s->rpm_flags;

    /* which controller */
    if (p->edge - track_pos > 0.0 && p->edge + track_pos > 0.0) {
        setpoint = p->centre_setpoint;
        kp = p->centre_kp;
        ki = p->centre_ki;
        kd = p->centre_kd;
    } else {
        setpoint = p->side_setpoint;
        kp = p->side_kp;
        ki = p->side_ki;
        kd = p->side_kd;
    }

    /* the PID law, the sum from the oldest error to the newest */
    j = s->oldest;
    sum = setpoint - s->rpm[j];
    for (i = 1; i < HAND_WINDOW; i++) {
        if (++j == HAND_WINDOW) {
            j = 0;
        }
        sum = (setpoint - s->rpm[j]) + sum;
    }
    accel = kp * (setpoint - rpm) + ki * sum + kd * (s->rpm[before] - rpm);

    /* never a NaN, never outside the actuator's range */
    if (isnan(accel)) {
        accel = 0.0;
        status |= HAND_SAFE;
    } else if (accel < 0.0) {
        accel = 0.0;
    } else if (accel > 1.0) {
        accel = 1.0;
    }
    out->Accel = accel;
    return status;
}
