/* The 29 readings of a car, scaled, in the order that the reference experiments use. */
#ifndef PIRLC_TORCS_READINGS_H
#define PIRLC_TORCS_READINGS_H

#include <vector>

#include <car.h>
#include <raceman.h>
#include <track.h>

namespace torcs_pirlc {

/* Places in the vector of readings. */
enum { SPEED_X, ANGLE, TRACK_POS, SPEED_Y, SPEED_Z, RPM, WHEEL_SPIN, BEAM = 10, READINGS = 29 };

const int BEAMS = 19;
const double RANGE = 200.0; /* m, of a beam */

struct Point {
    double x, y;
};

/* The road as a ring of short pieces, each with its two edges. */
class Road {
  public:
    explicit Road(tTrack *track);

    /* Distances (m) from a point on the road to its edge, at most RANGE, along each of the BEAMS
       of a car there that faces `yaw` (rad). `at` says where on the road the point is. */
    void look(const tTrkLocPos &at, Point from, double yaw, double *metres) const;

    const std::vector<Point> &left() const { return left_; }
    const std::vector<Point> &right() const { return right_; }

  private:
    size_t piece(const tTrkLocPos &at) const;

    std::vector<Point> left_, right_;     /* where piece i begins */
    std::vector<size_t> first_, count_; /* of each segment's pieces, by the segment's id */
};

/* Fills in all READINGS; without `beams` theirs are 0. */
void read(const tCarElt *car, const Road &road, bool beams, double *readings);

/* Signed position on the road: 1 at the left edge, -1 at the right one. */
double track_position(const tCarElt *car);

/* Angle (rad) between the road's direction and the car's axis. */
double angle_to_road(const tCarElt *car);

/* The gear that the reference experiments drive in, for a speed in km/h. */
int gear_for(double speed);

} // namespace torcs_pirlc

#endif
