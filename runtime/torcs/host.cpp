/* The host robot: a TORCS robot that races for whoever is at the other end of a socket.
   See protocol.h for what they say to each other. */
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <memory>
#include <random>
#include <sched.h>
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

#include "driving.h"
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

struct Race {
    pirlc_request asked;
    std::unique_ptr<Controller> controller;
    std::vector<pirlc_frame> trace; /* what is not sent yet */
    pirlc_frame latest;
    std::mt19937_64 random;
    double start, damage, distance, collisions;
    long steps;
    uint32_t processor;
    bool begun, over;
};

/* More than any program has: the emitted library fills in as many as it likes. */
const size_t ROOM_FOR_PARAMS = 1 << 16;

int channel = -1;
bool waiting = true; /* in the first process, which never leaves the grid */
tTrack *track = nullptr;
std::unique_ptr<torcs_pirlc::Road> road;
std::unique_ptr<tRobotItf> passenger; /* another robot of TORCS, called through */
Race race = {};

bool receive(void *place, size_t size) {
    char *at = static_cast<char *>(place);
    while (size > 0) {
        const ssize_t got = recv(channel, at, size, 0);
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return false;
        at += got;
        size -= static_cast<size_t>(got);
    }
    return true;
}

/* Whoever was listening may be gone: then this process has nothing left to do. */
void deliver(const void *place, size_t size) {
    const char *at = static_cast<const char *>(place);
    while (size > 0) {
        const ssize_t put = send(channel, at, size, MSG_NOSIGNAL);
        if (put < 0 && errno == EINTR) continue;
        if (put <= 0) _exit(0);
        at += put;
        size -= static_cast<size_t>(put);
    }
}

void deliver_trace() {
    const pirlc_trace_header header = {race.trace.size()};
    deliver(&header, sizeof header);
    deliver(race.trace.data(), race.trace.size() * sizeof(pirlc_frame));
    race.trace.clear();
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

/* TORCS stops calling `drive` when it takes the car out, and exits when no car is left: the last
   frame is the latest one, under another name. */
void at_exit() {
    if (waiting || race.over) return;
    pirlc_frame last = race.latest;
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

template <typename Function> Function function(void *library, const char *name) {
    return reinterpret_cast<Function>(dlsym(library, name));
}

bool load_controller() {
    void *library = dlopen(race.asked.library, RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) return false;
    std::unique_ptr<Controller> made(new Controller);
    const auto size = function<unsigned long (*)(void)>(library, "bridge_state_size");
    const auto reset = function<void (*)(void *)>(library, "bridge_reset");
    const auto defaults = function<void (*)(double *)>(library, "bridge_default_params");
    made->step = function<decltype(made->step)>(library, "bridge_step");
    if (!size || !reset || !defaults || !made->step) return false;
    made->state.reset(new char[size() + 1]);
    reset(made->state.get());
    made->params.assign(ROOM_FOR_PARAMS, 0.0);
    defaults(made->params.data());
    for (int32_t i = 0; i < race.asked.parameters && i < PIRLC_MOST_PARAMS; ++i)
        made->params[static_cast<size_t>(i)] = race.asked.params[i];
    race.controller = std::move(made);
    return true;
}

void prepare() {
    race.random.seed(race.asked.seed);
    /* This process's own copy of the track: the next race starts from the parent's again. */
    if (race.asked.grip < 1.0 || race.asked.grip > 1.0)
        for (tTrackSurface *s = track->surfaces; s != nullptr; s = s->next)
            s->kFriction = static_cast<tdble>(static_cast<double>(s->kFriction) * race.asked.grip);
    if (race.asked.kind == PIRLC_NATIVE && !load_controller()) {
        pirlc_frame last = {};
        last.status = PIRLC_NO_CONTROLLER;
        finish(last);
    }
}

/* A race that was not run to its end may have stopped in the middle of a word: nothing more can be
   said after it, so this process ends too. */
void await(pid_t child) {
    int status = 0;
    if (child < 0) {
        dprintf(STDOUT_FILENO, "no process could be made for a race\n");
        _exit(1);
    }
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (status == 0) return;
    if (WIFSIGNALED(status))
        dprintf(STDOUT_FILENO, "a race was ended by signal %d\n", WTERMSIG(status));
    else
        dprintf(STDOUT_FILENO, "a race ended with exit status %d\n", WEXITSTATUS(status));
    _exit(1);
}

/* Stays here in the first process; returns in each child, with the race that it has to run. */
void wait_on_the_grid() {
    while (receive(&race.asked, sizeof race.asked)) {
        if (race.asked.protocol != PIRLC_PROTOCOL) {
            dprintf(STDOUT_FILENO, "this host was built for another version of pirlc\n");
            _exit(1);
        }
        if (race.asked.kind == PIRLC_TRACK) {
            deliver_track();
            continue;
        }
        const pid_t parent = getpid();
        const pid_t child = fork();
        if (child == 0) {
            prctl(PR_SET_PDEATHSIG, SIGKILL);
            if (getppid() != parent) _exit(0); /* it died before the line above */
            waiting = false;
            prepare();
            return;
        }
        await(child);
    }
    _exit(0);
}

double uniform() {
    return static_cast<double>(race.random() >> 11) * (1.0 / 9007199254740992.0);
}

/* Marsaglia's polar method: the standard library's normal distribution may differ by version. */
double normal() {
    double u, v, s;
    do {
        u = 2 * uniform() - 1;
        v = 2 * uniform() - 1;
        s = u * u + v * v;
    } while (s >= 1 || s <= 0);
    return u * sqrt(-2 * log(s) / s);
}

void disturb(double *readings) {
    if (race.asked.noise > 0)
        for (int i = 0; i < PIRLC_READINGS; ++i) readings[i] *= 1 + race.asked.noise * normal();
    if (race.asked.blocked != 0)
        for (int i = 0; i < PIRLC_READINGS; ++i)
            if ((race.asked.blocked >> i & 1u) && uniform() < race.asked.block_probability)
                readings[i] = NAN;
}

double reward_of(const tCarElt *car, double gained, double hurt) {
    const double v = static_cast<double>(car->_speed_x) * 3.6;
    const double angle = torcs_pirlc::angle_to_road(car);
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
        static_cast<double>(car->_speed_x) * 3.6 * cos(angle) < asked.slow)
        return PIRLC_TOO_SLOW;
    if (asked.backwards && cos(angle) < 0) return PIRLC_BACKWARDS;
    if (asked.most_steps > 0 && race.steps >= asked.most_steps) return PIRLC_TIME_LIMIT;
    return PIRLC_RUNNING;
}

pirlc_frame frame_of(const tCarElt *car, const tSituation *situation) {
    pirlc_frame frame = {};
    if (!race.begun) {
        race.begun = true;
        race.start = race.distance = static_cast<double>(car->_distRaced);
        race.damage = car->_dammage;
    } else {
        ++race.steps;
    }
    const double distance = static_cast<double>(car->_distRaced);
    const double gained = distance - race.distance, hurt = car->_dammage - race.damage;
    race.distance = distance;
    race.damage = car->_dammage;
    if (car->priv.simcollision & SEM_COLLISION_XYSCENE) race.collisions += 1;
    frame.reward = race.steps > 0 ? reward_of(car, gained, hurt) : 0;
    frame.time = situation->currentTime;
    frame.laps = car->_laps > 0 ? car->_laps - 1 : 0; /* TORCS counts the one under way */
    frame.lap_time = static_cast<double>(car->_lastLapTime);
    frame.distance = race.distance - race.start;
    frame.damage = car->_dammage;
    frame.x = static_cast<double>(car->_pos_X);
    frame.y = static_cast<double>(car->_pos_Y);
    frame.yaw = static_cast<double>(car->_yaw);
    frame.to_middle = static_cast<double>(car->_trkPos.toMiddle);
    frame.width = static_cast<double>(car->_trkPos.seg->width);
    frame.speed = static_cast<double>(car->_speed_x);
    frame.gear = car->_gear;
    frame.fuel = static_cast<double>(car->_fuel);
    frame.collisions = race.collisions;
    frame.invalid = !car->_commitBestLapTime;
    for (double &component : frame.command) component = NAN;
    torcs_pirlc::read(car, *road, race.asked.beams != 0, frame.readings);
    disturb(frame.readings);
    frame.status = status_of(car, frame);
    return frame;
}

/* Runs where whoever drives runs: to switch processes on one processor takes a fraction of the
   time that waking another one does. */
void move_to(uint32_t processor) {
    if (processor == race.processor) return;
    race.processor = processor;
    if (processor == 0 || processor > CPU_SETSIZE) return;
    cpu_set_t only;
    CPU_ZERO(&only);
    CPU_SET(processor - 1, &only);
    sched_setaffinity(0, sizeof only, &only); /* in vain where it is not allowed: only slower */
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
    move_to(command.processor);
    return command;
}

/* What the car is told to do, also into the frame. */
void command_car(tCarElt *car, pirlc_frame &frame) {
    const pirlc_command told = ask(frame);
    torcs_pirlc::Command command = {told.steer, told.accel, told.brake};
    if (!torcs_pirlc::is_finite(command)) {
        frame.status = PIRLC_BAD_ACTION;
        finish(frame);
    }
    command = torcs_pirlc::clipped(command);
    torcs_pirlc::apply(car, command);
    frame.command[0] = command.steer;
    frame.command[1] = command.accel;
    frame.command[2] = command.brake;
}

void drive(int index, tCarElt *car, tSituation *situation) {
    if (waiting) wait_on_the_grid();
    pirlc_frame &frame = race.latest;
    frame = frame_of(car, situation);
    if (frame.status > double{PIRLC_RUNNING}) finish(frame);
    if (race.asked.kind == PIRLC_ROBOT) {
        passenger->rbDrive(index, car, situation);
        frame.command[0] = static_cast<double>(car->_steerCmd);
        frame.command[1] = static_cast<double>(car->_accelCmd);
        frame.command[2] = static_cast<double>(car->_brakeCmd);
    } else {
        command_car(car, frame);
    }
    if (race.asked.kind == PIRLC_LOCK_STEP) return;
    race.trace.push_back(frame);
    if (race.trace.size() == race.asked.part) deliver_trace();
}

void new_track(int index, tTrack *given, void *car, void **settings, tSituation *situation) {
    track = given;
    road.reset(new torcs_pirlc::Road(given));
    *settings = nullptr;
    if (passenger) passenger->rbNewTrack(index, given, car, settings, situation);
}

void new_race(int index, tCarElt *car, tSituation *situation) {
    if (passenger) passenger->rbNewRace(index, car, situation);
}

/* Never called: the first process waits on the grid until it is not needed any more, and the others
   end with their races. */
void end_race(int, tCarElt *, tSituation *) {}
void shut_down(int) {}

/* Practice is driven alone, and races end before the tank is empty; a passenger knows itself. */
int pit(int index, tCarElt *car, tSituation *situation) {
    return passenger ? passenger->rbPitCmd(index, car, situation) : ROB_PIT_IM;
}

int initialise(int index, void *interface) {
    tRobotItf *robot = static_cast<tRobotItf *>(interface);
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
    const auto entry = function<int (*)(tModInfo *)>(library, name);
    if (entry == nullptr) return false;
    static tModInfo offered[MAX_MOD_ITF];
    memset(offered, 0, sizeof offered);
    if (entry(offered) != 0) return false;
    for (int i = 0; i < MAX_MOD_ITF; ++i) {
        if (offered[i].fctInit == nullptr || offered[i].index != index) continue;
        passenger.reset(new tRobotItf());
        offered[i].fctInit(index, passenger.get());
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
