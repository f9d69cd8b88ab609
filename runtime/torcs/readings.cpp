#include "readings.h"

#include <cmath>

#include <robottools.h>
#include <tgf.h>

namespace torcs_pirlc {

namespace {

const double DEGREES[BEAMS] = {-45, -19, -12, -7, -4,  -2.5, -1.7, -1, -0.5, 0,
                               0.5, 1,   1.7, 2.5, 4, 7,    12,   19, 45};
const double SAGITTA = 0.01; /* m, by which a piece's chord may miss the arc */
const double WHOLE = 6.283185307179586;

Point edge(tTrackSeg *segment, tdble to_start, int side) {
    tTrkLocPos place;
    place.seg = segment;
    place.type = TR_LPOS_MAIN;
    place.toStart = to_start;
    place.toRight = place.toLeft = place.toMiddle = 0;
    tdble x, y;
    RtTrackLocal2Global(&place, &x, &y, side);
    return {x, y};
}

size_t pieces_of(const tTrackSeg *segment) {
    if (segment->type == TR_STR) return 1;
    const double radius = fmax(segment->radiusl, segment->radiusr);
    const double half = acos(fmax(0.0, 1.0 - SAGITTA / radius));
    return (size_t)ceil(segment->arc / (2 * half));
}

/* Where the ray from `from` along (dx, dy) meets the line from a to b; negative if it does not. */
double meeting(Point from, double dx, double dy, Point a, Point b) {
    const double ex = b.x - a.x, ey = b.y - a.y;
    const double across = dx * ey - dy * ex;
    if (across == 0) return -1;
    const double ax = a.x - from.x, ay = a.y - from.y;
    const double along_edge = (ax * dy - ay * dx) / across;
    if (along_edge < 0 || along_edge > 1) return -1;
    return (ax * ey - ay * ex) / across;
}

double norm_pi(double angle) {
    return angle - WHOLE * floor(angle / WHOLE + 0.5);
}

} // namespace

Road::Road(tTrack *track) : first_(track->nseg), count_(track->nseg) {
    tTrackSeg *segment = track->seg->next; /* the list's head is the last segment */
    for (int i = 0; i < track->nseg; ++i, segment = segment->next) {
        const size_t count = pieces_of(segment);
        const double whole = segment->type == TR_STR ? segment->length : segment->arc;
        first_[segment->id] = left_.size();
        count_[segment->id] = count;
        for (size_t k = 0; k < count; ++k) {
            const tdble to_start = (tdble)(whole * (double)k / (double)count);
            left_.push_back(edge(segment, to_start, TR_TOLEFT));
            right_.push_back(edge(segment, to_start, TR_TORIGHT));
        }
    }
}

size_t Road::piece(const tTrkLocPos &at) const {
    const double whole = at.seg->type == TR_STR ? at.seg->length : at.seg->arc;
    const size_t count = count_[at.seg->id];
    const double fraction = fmin(fmax(at.toStart / whole, 0.0), 1.0);
    const size_t k = (size_t)(fraction * (double)count);
    return first_[at.seg->id] + (k < count ? k : count - 1);
}

double Road::distance(const tTrkLocPos &at, Point from, double direction) const {
    const size_t n = left_.size(), start = piece(at);
    const double dx = cos(direction), dy = sin(direction);
    /* The ray leaves the road through the first piece, in the order of the road, whose edge it
       meets; it runs along the road forwards or, if the car stands askew, backwards. */
    double nearest = RANGE;
    for (int forwards = 1; forwards >= 0; --forwards) {
        size_t i = start;
        for (size_t walked = 0; walked < n; ++walked) {
            const size_t next = i + 1 == n ? 0 : i + 1;
            const double l = meeting(from, dx, dy, left_[i], left_[next]);
            const double r = meeting(from, dx, dy, right_[i], right_[next]);
            const double hit = l < 0 ? r : r < 0 ? l : fmin(l, r);
            if (hit >= 0) {
                nearest = fmin(nearest, hit);
                break;
            }
            i = forwards ? next : i == 0 ? n - 1 : i - 1;
            const double away_x = left_[i].x - from.x, away_y = left_[i].y - from.y;
            const double across_x = right_[i].x - from.x, across_y = right_[i].y - from.y;
            const double far = 4 * RANGE * RANGE;
            if (away_x * away_x + away_y * away_y > far &&
                across_x * across_x + across_y * across_y > far)
                break;
        }
    }
    return nearest;
}

double track_position(const tCarElt *car) {
    return 2.0 * (double)car->_trkPos.toMiddle / (double)car->_trkPos.seg->width;
}

double angle_to_road(const tCarElt *car) {
    tTrkLocPos place = car->_trkPos;
    return norm_pi((double)RtTrackSideTgAngleL(&place) - (double)car->_yaw);
}

void read(const tCarElt *car, const Road &road, bool beams, double *readings) {
    const double position = track_position(car);
    readings[SPEED_X] = (double)car->_speed_x * 3.6 / 300.0;
    readings[ANGLE] = angle_to_road(car) / 3.1416;
    readings[TRACK_POS] = position;
    readings[SPEED_Y] = (double)car->_speed_y * 3.6 / 300.0;
    readings[SPEED_Z] = (double)car->_speed_z * 3.6 / 300.0;
    readings[RPM] = (double)car->_enginerpm * 10.0 / 10000.0;
    for (int i = 0; i < 4; ++i)
        readings[WHEEL_SPIN + i] = (double)car->_wheelSpinVel(i) / 100.0;
    const Point here = {car->_pos_X, car->_pos_Y};
    for (int i = 0; i < BEAMS; ++i) {
        double metres = 0;
        if (beams) {
            /* The first beam looks to the left; angles in the plane grow to the left. */
            const double direction = (double)car->_yaw - DEGREES[i] * (WHOLE / 360.0);
            metres = fabs(position) > 1 ? -1 : road.distance(car->_trkPos, here, direction);
        }
        readings[BEAM + i] = metres / 200.0;
    }
}

int gear_for(double speed) {
    if (speed > 170) return 6;
    if (speed > 140) return 5;
    if (speed > 110) return 4;
    if (speed > 80) return 3;
    if (speed > 50) return 2;
    return 1;
}

} // namespace torcs_pirlc
