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
    return {static_cast<double>(x), static_cast<double>(y)};
}

/* In the unit of toStart: metres, or radians of a bend. */
tdble extent(const tTrackSeg *segment) {
    return segment->type == TR_STR ? segment->length : segment->arc;
}

size_t pieces_of(const tTrackSeg *segment) {
    if (segment->type == TR_STR) return 1;
    const double radius = static_cast<double>(fmaxf(segment->radiusl, segment->radiusr));
    const double half = acos(fmax(0.0, 1.0 - SAGITTA / radius));
    return static_cast<size_t>(ceil(static_cast<double>(segment->arc) / (2 * half)));
}

Point minus(Point a, Point b) {
    return {a.x - b.x, a.y - b.y};
}

/* Positive if b points to the left of a. */
double cross(Point a, Point b) {
    return a.x * b.y - a.y * b.x;
}

double dot(Point a, Point b) {
    return a.x * b.x + a.y * b.y;
}

/* How far along `ray`, from the origin, the line through a and b is. */
double meeting(Point ray, Point a, Point b) {
    const Point along = minus(b, a);
    return cross(a, along) / cross(ray, along);
}

/* `at` if it is to the right of the line from a to b, else the nearest point there. */
Point right_of(Point at, Point a, Point b) {
    const Point along = minus(b, a);
    const double beyond = cross(along, minus(at, a)) / dot(along, along);
    if (beyond < 0) return at;
    return {at.x + along.y * beyond, at.y - along.x * beyond};
}

double norm_pi(double angle) {
    return angle - WHOLE * floor(angle / WHOLE + 0.5);
}

} // namespace

Road::Road(tTrack *track)
    : first_(static_cast<size_t>(track->nseg)), count_(static_cast<size_t>(track->nseg)) {
    tTrackSeg *segment = track->seg->next; /* the list's head is the last segment */
    for (int i = 0; i < track->nseg; ++i, segment = segment->next) {
        const size_t id = static_cast<size_t>(segment->id), count = pieces_of(segment);
        const double whole = static_cast<double>(extent(segment));
        first_[id] = left_.size();
        count_[id] = count;
        for (size_t k = 0; k < count; ++k) {
            const double to_start = whole * static_cast<double>(k) / static_cast<double>(count);
            left_.push_back(edge(segment, static_cast<tdble>(to_start), TR_TOLEFT));
            right_.push_back(edge(segment, static_cast<tdble>(to_start), TR_TORIGHT));
        }
    }
}

size_t Road::piece(const tTrkLocPos &at) const {
    const size_t id = static_cast<size_t>(at.seg->id), count = count_[id];
    const double done = static_cast<double>(at.toStart) / static_cast<double>(extent(at.seg));
    const double fraction = fmin(fmax(done, 0.0), 1.0);
    const size_t k = static_cast<size_t>(fraction * static_cast<double>(count));
    return first_[id] + (k < count ? k : count - 1);
}

void Road::look(const tTrkLocPos &at, Point from, double yaw, double *metres) const {
    const size_t n = left_.size(), start = piece(at), after = start + 1 == n ? 0 : start + 1;
    /* On the outside of a bend the road reaches a little beyond the pieces' chords. */
    from = right_of(from, left_[start], left_[after]);
    from = right_of(from, right_[after], right_[start]);
    const auto left = [&](size_t i) { return minus(left_[i], from); };
    const auto right = [&](size_t i) { return minus(right_[i], from); };

    /* A ray goes from piece to piece, through the borders between them, until it misses a border:
       there it has left the road through the side of the piece before. Rays are in order from left
       to right, so only the outermost of those that are still on the road can miss the next
       border. Backwards, if the car stands askew, the sides change places. */
    Point rays[BEAMS];
    int ahead[BEAMS], behind[BEAMS], all_ahead = 0, all_behind = 0;
    for (int beam = 0; beam < BEAMS; ++beam) {
        /* The first beam looks to the left; angles in the plane grow to the left. */
        const double direction = yaw - DEGREES[beam] * (WHOLE / 360.0);
        const Point ray = rays[beam] = {cos(direction), sin(direction)};
        if (cross(ray, left(after)) > 0 && cross(ray, right(after)) < 0) {
            ahead[all_ahead++] = beam;
        } else if (cross(ray, left(start)) < 0 && cross(ray, right(start)) > 0) {
            behind[all_behind++] = beam;
        } else {
            const bool to_left = cross(minus(left_[after], left_[start]), ray) > 0;
            const bool to_right = cross(minus(right_[after], right_[start]), ray) < 0;
            double nearest = RANGE;
            if (to_left) nearest = fmin(nearest, meeting(ray, left(start), left(after)));
            if (to_right) nearest = fmin(nearest, meeting(ray, right(start), right(after)));
            metres[beam] = fmax(nearest, 0.0);
        }
    }
    for (int backwards = 0; backwards <= 1; ++backwards) {
        const int *beams = backwards ? behind : ahead;
        int first = 0, last = (backwards ? all_behind : all_ahead) - 1;
        /* Of what lies behind, the left side is to the right. */
        const std::vector<Point> &lefts = backwards ? right_ : left_;
        const std::vector<Point> &rights = backwards ? left_ : right_;
        size_t i = backwards ? start : after; /* the border just passed */
        for (size_t passed = 0; passed < n && first <= last; ++passed) {
            const Point l = minus(lefts[i], from), r = minus(rights[i], from);
            const double width = sqrt(dot(minus(l, r), minus(l, r)));
            if (dot(l, l) > (RANGE + width) * (RANGE + width)) break;
            const size_t next = backwards ? (i == 0 ? n - 1 : i - 1) : (i + 1 == n ? 0 : i + 1);
            const Point next_l = minus(lefts[next], from), next_r = minus(rights[next], from);
            for (; first <= last && cross(rays[beams[first]], next_l) <= 0; ++first)
                metres[beams[first]] = fmin(RANGE, meeting(rays[beams[first]], l, next_l));
            for (; first <= last && cross(rays[beams[last]], next_r) >= 0; --last)
                metres[beams[last]] = fmin(RANGE, meeting(rays[beams[last]], r, next_r));
            i = next;
        }
        for (; first <= last; ++first) metres[beams[first]] = RANGE;
    }
}

double track_position(const tCarElt *car) {
    const tTrkLocPos &place = car->_trkPos;
    return 2.0 * static_cast<double>(place.toMiddle) / static_cast<double>(place.seg->width);
}

double angle_to_road(const tCarElt *car) {
    tTrkLocPos place = car->_trkPos;
    const double road = static_cast<double>(RtTrackSideTgAngleL(&place));
    return norm_pi(road - static_cast<double>(car->_yaw));
}

void read(const tCarElt *car, const Road &road, bool beams, double *readings) {
    const double position = track_position(car);
    readings[SPEED_X] = static_cast<double>(car->_speed_x) * 3.6 / 300.0;
    readings[ANGLE] = angle_to_road(car) / 3.1416;
    readings[TRACK_POS] = position;
    readings[SPEED_Y] = static_cast<double>(car->_speed_y) * 3.6 / 300.0;
    readings[SPEED_Z] = static_cast<double>(car->_speed_z) * 3.6 / 300.0;
    readings[RPM] = static_cast<double>(car->_enginerpm) * 10.0 / 10000.0;
    for (int i = 0; i < 4; ++i)
        readings[WHEEL_SPIN + i] = static_cast<double>(car->_wheelSpinVel(i)) / 100.0;
    double metres[BEAMS] = {};
    if (beams && fabs(position) > 1) {
        for (double &beam : metres) beam = -1;
    } else if (beams) {
        const double x = static_cast<double>(car->_pos_X), y = static_cast<double>(car->_pos_Y);
        road.look(car->_trkPos, {x, y}, static_cast<double>(car->_yaw), metres);
    }
    for (int i = 0; i < BEAMS; ++i) readings[BEAM + i] = metres[i] / 200.0;
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
