/* From a controller's command to the controls of a car. */
#ifndef PIRLC_TORCS_DRIVING_H
#define PIRLC_TORCS_DRIVING_H

#include <cmath>
#include <cstring>

#include <car.h>
#include <raceman.h>
#include <track.h>

#include "readings.h"

namespace torcs_pirlc {

/* Steering from -1 (right) to 1 (left), accelerator and brake from 0 to 1. */
struct Command {
    double steer, accel, brake;
};

/* False where a component is NaN or infinite: such a command must not reach the simulator. */
inline bool is_finite(const Command &command) {
    return std::isfinite(command.steer) && std::isfinite(command.accel) &&
           std::isfinite(command.brake);
}

inline double within(double low, double value, double high) {
    return value < low ? low : value > high ? high : value;
}

/* The command with each component within its range. */
inline Command clipped(const Command &command) {
    return {within(-1, command.steer, 1), within(0, command.accel, 1),
            within(0, command.brake, 1)};
}

/* Sets the car's controls; the gear follows from the speed. */
inline void apply(tCarElt *car, const Command &command) {
    memset(&car->ctrl, 0, sizeof car->ctrl);
    car->_steerCmd = static_cast<tdble>(command.steer);
    car->_accelCmd = static_cast<tdble>(command.accel);
    car->_brakeCmd = static_cast<tdble>(command.brake);
    car->_gearCmd = gear_for(static_cast<double>(car->_speed_x) * 3.6);
}

} // namespace torcs_pirlc

#endif
