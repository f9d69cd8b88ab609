/* The host robot: a TORCS robot that races for whoever is at the other end of a socket.
   See protocol.h for what they say to each other. */
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <memory>
#include <random>
#include <string>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include <car.h>
#include <raceman.h>
#include <robot.h>
#include <tgf.h>
#include <track.h>

#include "protocol.h"
#include "readings.h"

static_assert(PIRLC_READINGS == torcs_pirlc::READINGS, "the protocol and the readings disagree");

namespace {

/* What a library that pirlc builds from an emitted controller offers. */
struct Controller {
    unsigned (*step)(const double *params, void *state, const double *readings, double *actions);
    std::vector<double> params;
    std::unique_ptr<char[]> state;
};

/* Another robot of TORCS, called through. */
struct Passenger {
    tRobotItf robot;
};

struct Race {
    pirlc_request asked;
    std::unique_ptr<Controller> controller;
    std::vector<pirlc_frame> trace;
    std::mt19937_64 random;
    double start = 0, damage = 0, distance = 0, collisions = 0;
    long steps = 0;
    bool begun = false, over = false;
};

int channel = -1;
bool waiting = true;
tTrack *track = nullptr;
std::unique_ptr<torcs_pirlc::Road> road;
std::unique_ptr<Passenger> passenger;
Race race;

bool receive(void *place, size_t size) {
    char *at = (char *)place;
    while (size > 0) {
        const ssize_t got = recv(channel, at, size, 0);
        if (got <= 0) return false;
        at += got;
        size -= (size_t)got;
    }
    return true;
}

/* Whoever was listening may be gone: then this process has nothing left to do. */
void deliver(const void *place, size_t size) {
    const char *at = (const char *)place;
    while (size > 0) {
        const ssize_t put = send(channel, at, size, MSG_NOSIGNAL);
        if (put <= 0) _exit(0);
        at += put;
        size -= (size_t)put;
    }
}

void deliver_trace() {
    const pirlc_trace_header header = {race.trace.size()};
    deliver(&header, sizeof header);
    deliver(race.trace.data(), race.trace.size() * sizeof(pirlc_frame));
}

/* Sends what says that the race has ended, and ends its process. */
[[noreturn]] void finish(const pirlc_frame &last) {
    race.over = true;
    if (race.asked.kind == PIRLC_LOCK_STEP) {
        deliver(&last, sizeof last);
    } else {
        race.trace.push_back(last);
        deliver_trace();
    }
    _exit(0);
}

/* TORCS ends a race by itself when it takes the car out. */
void at_exit() {
    if (waiting || race.over) return;
    pirlc_frame last = {};
    if (!race.trace.empty()) last = race.trace.back();
    last.status = PIRLC_OUT;
    last.reward = 0;
    for (double &component : last.command) component = NAN;
    finish(last);
}

void deliver_track() {
    const size_t n = road->left().size();
    const pirlc_trace_header header = {n};
    deliver(&header, sizeof header);
    for (size_t i = 0; i < n; ++i) {
        const torcs_pirlc::Point l = road->left()[i], r = road->right()[i];
        const double row[4] = {l.x, l.y, r.x, r.y};
        deliver(row, sizeof row);
    }
    const double length = track->length;
    deliver(&length, sizeof length);
}

bool load_controller() {
    void *library = dlopen(race.asked.library, RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) return false;
    typedef unsigned long (*size_function)(void);
    typedef void (*reset_function)(void *);
    typedef void (*params_function)(double *);
    std::unique_ptr<Controller> made(new Controller);
    const size_function size = (size_function)dlsym(library, "bridge_state_size");
    const reset_function reset = (reset_function)dlsym(library, "bridge_reset");
    const params_function defaults = (params_function)dlsym(library, "bridge_default_params");
    made->step = (decltype(made->step))dlsym(library, "bridge_step");
    if (!size || !reset || !defaults || !made->step) return false;
    made->state.reset(new char[size() + 1]);
    reset(made->state.get());
    made->params.assign(race.asked.params, race.asked.params + PIRLC_MOST_PARAMS);
    if (race.asked.parameters < 0) defaults(made->params.data());
    race.controller = std::move(made);
    return true;
}

void prepare() {
    race.random.seed(race.asked.seed);
    if (race.asked.grip != 1.0)
        for (tTrackSurface *s = track->surfaces; s != nullptr; s = s->next)
            s->kFriction = (tdble)(s->kFriction * race.asked.grip);
    if (race.asked.kind == PIRLC_NATIVE && !load_controller()) {
        pirlc_frame last = {};
        last.status = PIRLC_NO_CONTROLLER;
        finish(last);
    }
}

/* Stays here in the first process; returns in each child, with the race that it has to run. */
void wait_on_the_grid() {
    while (receive(&race.asked, sizeof race.asked)) {
        if (race.asked.kind == PIRLC_TRACK) {
            deliver_track();
            continue;
        }
        const pid_t parent = getpid();
        const pid_t child = fork();
        if (child == 0) {
            prctl(PR_SET_PDEATHSIG, SIGKILL);
            if (getppid() != parent) _exit(0);
            waiting = false;
            prepare();
            return;
        }
        int status = 0;
        pirlc_frame last = {};
        last.status = PIRLC_DIED;
        if (child < 0 || waitpid(child, &status, 0) < 0 || status != 0) {
            last.time = child < 0 ? -1 : status;
            if (race.asked.kind == PIRLC_LOCK_STEP) {
                deliver(&last, sizeof last);
            } else {
                race.trace.assign(1, last);
                deliver_trace();
            }
        }
    }
    _exit(0);
}

double uniform() {
    return (double)(race.random() >> 11) * (1.0 / 9007199254740992.0);
}

/* Marsaglia's polar method: the standard library's normal distribution may differ by version. */
double normal() {
    double u, v, s;
    do {
        u = 2 * uniform() - 1;
        v = 2 * uniform() - 1;
        s = u * u + v * v;
    } while (s >= 1 || s == 0);
    return u * sqrt(-2 * log(s) / s);
}

void disturb(double *readings) {
    if (race.asked.noise > 0)
        for (int i = 0; i < PIRLC_READINGS; ++i) readings[i] *= 1 + race.asked.noise * normal();
    if (race.asked.blocked != 0)
        for (int i = 0; i < PIRLC_READINGS; ++i)
            if ((race.asked.blocked >> i & 1) && uniform() < race.asked.block_probability)
                readings[i] = NAN;
}

double reward_of(const tCarElt *car, double gained, double hurt) {
    const double v = (double)car->_speed_x * 3.6, angle = torcs_pirlc::angle_to_road(car);
    switch (race.asked.reward) {
    case PIRLC_REWARD_NDPS:
        if (hurt > 0) return -1;
        return v * cos(angle) - fabs(v * sin(angle)) - v * fabs(torcs_pirlc::track_position(car));
    case PIRLC_REWARD_GYM_TORCS:
        return hurt > 0 ? -1 : v * cos(angle);
    default:
        return gained - 0.1 * hurt;
    }
}

double status_of(const tCarElt *car, const pirlc_frame &frame) {
    const pirlc_request &asked = race.asked;
    const double angle = torcs_pirlc::angle_to_road(car);
    if (asked.laps > 0 && frame.laps >= asked.laps) return PIRLC_FINISHED;
    if (car->_state & (RM_CAR_STATE_BROKEN | RM_CAR_STATE_OUTOFGAS | RM_CAR_STATE_ELIMINATED))
        return PIRLC_OUT;
    if (fabs(torcs_pirlc::track_position(car)) > asked.off_track) return PIRLC_OFF_TRACK;
    if (asked.slow_after >= 0 && race.steps > asked.slow_after &&
        (double)car->_speed_x * 3.6 * cos(angle) < asked.slow)
        return PIRLC_TOO_SLOW;
    if (asked.backwards && cos(angle) < 0) return PIRLC_BACKWARDS;
    if (asked.most_steps > 0 && race.steps >= asked.most_steps) return PIRLC_TIME_LIMIT;
    return PIRLC_RUNNING;
}

pirlc_frame frame_of(const tCarElt *car, const tSituation *situation) {
    pirlc_frame frame = {};
    if (!race.begun) {
        race.begun = true;
        race.start = race.distance = car->_distRaced;
        race.damage = car->_dammage;
    } else {
        ++race.steps;
    }
    const double gained = car->_distRaced - race.distance, hurt = car->_dammage - race.damage;
    race.distance = car->_distRaced;
    race.damage = car->_dammage;
    if (car->priv.simcollision & SEM_COLLISION_XYSCENE) race.collisions += 1;
    frame.reward = race.steps > 0 ? reward_of(car, gained, hurt) : 0;
    frame.time = situation->currentTime;
    frame.laps = car->_laps > 0 ? car->_laps - 1 : 0;
    frame.lap_time = car->_lastLapTime;
    frame.distance = race.distance - race.start;
    frame.damage = car->_dammage;
    frame.x = car->_pos_X;
    frame.y = car->_pos_Y;
    frame.yaw = car->_yaw;
    frame.to_middle = car->_trkPos.toMiddle;
    frame.width = car->_trkPos.seg->width;
    frame.speed = car->_speed_x;
    frame.gear = car->_gear;
    frame.fuel = car->_fuel;
    frame.collisions = race.collisions;
    frame.invalid = !car->_commitBestLapTime;
    for (double &component : frame.command) component = NAN;
    torcs_pirlc::read(car, *road, race.asked.beams != 0, frame.readings);
    disturb(frame.readings);
    frame.status = status_of(car, frame);
    return frame;
}

pirlc_command ask(const pirlc_frame &frame) {
    pirlc_command command = {};
    if (race.controller) {
        Controller &driver = *race.controller;
        double actions[PIRLC_ACTIONS] = {0, 0, 0};
        driver.step(driver.params.data(), driver.state.get(), frame.readings, actions);
        command.steer = actions[0];
        command.accel = actions[1];
        command.brake = race.asked.components > 2 ? actions[2] : 0;
        return command;
    }
    deliver(&frame, sizeof frame);
    if (!receive(&command, sizeof command) || command.leave != 0) _exit(0);
    return command;
}

/* The car's controls from a command; the gear follows from the speed. */
void apply(tCarElt *car, const pirlc_command &command) {
    memset(&car->ctrl, 0, sizeof car->ctrl);
    car->_steerCmd = (tdble)command.steer;
    car->_accelCmd = (tdble)command.accel;
    car->_brakeCmd = (tdble)command.brake;
    car->_gearCmd = torcs_pirlc::gear_for((double)car->_speed_x * 3.6);
}

void drive(int index, tCarElt *car, tSituation *situation) {
    if (waiting) wait_on_the_grid();
    pirlc_frame frame = frame_of(car, situation);
    if (frame.status != PIRLC_RUNNING) finish(frame);
    if (race.asked.kind == PIRLC_ROBOT) {
        passenger->robot.rbDrive(index, car, situation);
        frame.command[0] = car->_steerCmd;
        frame.command[1] = car->_accelCmd;
        frame.command[2] = car->_brakeCmd;
    } else {
        const pirlc_command command = ask(frame);
        if (!std::isfinite(command.steer) || !std::isfinite(command.accel) ||
            !std::isfinite(command.brake)) {
            frame.status = PIRLC_BAD_ACTION;
            finish(frame);
        }
        apply(car, command);
        frame.command[0] = command.steer;
        frame.command[1] = command.accel;
        frame.command[2] = command.brake;
    }
    if (race.asked.kind != PIRLC_LOCK_STEP) race.trace.push_back(frame);
}

void new_track(int index, tTrack *given, void *car, void **settings, tSituation *situation) {
    track = given;
    road.reset(new torcs_pirlc::Road(given));
    *settings = nullptr;
    if (passenger) passenger->robot.rbNewTrack(index, given, car, settings, situation);
}

void new_race(int index, tCarElt *car, tSituation *situation) {
    if (passenger) passenger->robot.rbNewRace(index, car, situation);
}

void end_race(int, tCarElt *, tSituation *) {}

void shut_down(int) {}

/* Nobody goes to the pits: practice is driven alone, and races end before the tank is empty. */
int pit(int index, tCarElt *car, tSituation *situation) {
    return passenger ? passenger->robot.rbPitCmd(index, car, situation) : ROB_PIT_IM;
}

int initialise(int index, void *interface) {
    tRobotItf *robot = (tRobotItf *)interface;
    robot->rbNewTrack = new_track;
    robot->rbNewRace = new_race;
    robot->rbEndRace = end_race;
    robot->rbDrive = drive;
    robot->rbPitCmd = pit;
    robot->rbShutdown = shut_down;
    robot->index = index;
    return 0;
}

/* The robot to call through: its module, its entry point's name, its index. */
bool take_passenger(const char *module, const char *name, int index) {
    void *library = dlopen(module, RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) return false;
    typedef int (*entry_function)(tModInfo *);
    const entry_function entry = (entry_function)dlsym(library, name);
    if (entry == nullptr) return false;
    static tModInfo offered[MAX_MOD_ITF];
    memset(offered, 0, sizeof offered);
    if (entry(offered) != 0) return false;
    for (int i = 0; i < MAX_MOD_ITF; ++i) {
        if (offered[i].fctInit == nullptr || offered[i].index != index) continue;
        passenger.reset(new Passenger);
        memset(&passenger->robot, 0, sizeof passenger->robot);
        offered[i].fctInit(index, &passenger->robot);
        return true;
    }
    return false;
}

} // namespace

/* TORCS's entry point; named like the module. */
extern "C" int pirlc(tModInfo *offered) {
    const char *socket = getenv("PIRLC_TORCS_CHANNEL");
    if (socket == nullptr) return -1;
    channel = atoi(socket);
    const char *module = getenv("PIRLC_TORCS_ROBOT"), *name = getenv("PIRLC_TORCS_ROBOT_NAME");
    const char *number = getenv("PIRLC_TORCS_ROBOT_INDEX");
    const int index = number == nullptr ? 1 : atoi(number);
    if (module != nullptr && name != nullptr && !take_passenger(module, name, index)) return -1;
    atexit(at_exit);
    static char title[] = "pirlc", description[] = "races for pirlc";
    memset(offered, 0, MAX_MOD_ITF * sizeof(tModInfo));
    offered[0].name = title;
    offered[0].desc = description;
    offered[0].fctInit = initialise;
    offered[0].gfId = ROB_IDENT;
    offered[0].index = index;
    return 0;
}
