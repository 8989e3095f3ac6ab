/* ziegler.cpp - Ziegler's column under a follower force, by Debian's Simbody, stopped by modald
 *
 * Two links of length l = 1, masses 2m and m (m = 1) at their ends, springs k = 1 and dampers b in
 * the joints, a force P along the second link: p = P l / k, beta = b / (l sqrt(k m)) = 0.1.
 * Unstable above p_d = 41/28 + beta^2 / 2 = 1.46929, though without damping only above
 * 7/2 - sqrt 2: a little damping destabilises.
 *
 * usage: example_ziegler NAME P [STEPS] [START] [PACE]
 *     START: the first angles, default 1e-5; PACE: seconds of real time a step
 * prints: `steps N tip T verdict V`, T the largest |tip| over l, and the rows on fd 3 where it is
 *     open (for tests)
 */
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <unistd.h>
#include "Simbody.h"
#include "modald_stream.h"

using namespace SimTK;

/* The follower force: magnitude P at the tip, along the second link, towards the joint. */
class Follower : public Force::Custom::Implementation {
public:
    Follower(const SimbodyMatterSubsystem &all, const MobilizedBody &on, Real magnitude)
        : matter(all), body(on), size(magnitude) { }
    void calcForce(const State &state, Vector_<SpatialVec> &bodies, Vector_<Vec3> &,
                   Vector &) const override
    {
        const Vec3 along = body.getBodyRotation(state) * Vec3(0, 1, 0);
        body.applyForceToBodyPoint(state, Vec3(0), -size * along, bodies);
    }
    Real calcPotentialEnergy(const State &) const override { return 0; }
    bool dependsOnlyOnPositions() const override { return true; }
private:
    const SimbodyMatterSubsystem &matter;
    MobilizedBody body;
    Real size;
};

int main(int argc, char **argv)
{
    const char *name = argc > 1 ? argv[1] : "ziegler";
    const double p = argc > 2 ? std::atof(argv[2]) : 1.6;
    const double start = argc > 4 ? std::atof(argv[4]) : 1e-5;
    const double pace = argc > 5 ? std::atof(argv[5]) : 0;
    const long most = argc > 3 ? std::atol(argv[3]) : 3001;
    const double dt = 0.1, beta = 0.1;

    MultibodySystem system;
    SimbodyMatterSubsystem matter(system);
    GeneralForceSubsystem forces(system);
    /* bodies are point masses at their origins, a link's length from the joint below */
    const Body::Rigid two(MassProperties(2, Vec3(0), Inertia(0)));
    const Body::Rigid one(MassProperties(1, Vec3(0), Inertia(0)));
    const Transform joint(Vec3(0)), below(Vec3(0, -1, 0));
    MobilizedBody::Pin lower(matter.Ground(), joint, two, below);
    MobilizedBody::Pin upper(lower, joint, one, below);
    Force::MobilityLinearSpring(forces, lower, MobilizerQIndex(0), 1, 0);
    Force::MobilityLinearSpring(forces, upper, MobilizerQIndex(0), 1, 0);
    Force::MobilityLinearDamper(forces, lower, MobilizerUIndex(0), beta);
    Force::MobilityLinearDamper(forces, upper, MobilizerUIndex(0), beta);
    Force::Custom(forces, new Follower(matter, upper, p));

    State state = system.realizeTopology();
    lower.setAngle(state, start);
    upper.setAngle(state, 0.5 * start);
    RungeKuttaMersonIntegrator integrator(system);
    integrator.setAccuracy(1e-10);
    integrator.setFinalTime(most * dt + 1);
    TimeStepper stepper(system, integrator);
    stepper.initialize(state);

    double tip = 0, y[2];
    long i = 0;
    modald_stream *s = modald_open(name, 2, dt);                           /* STREAM */
    for (; i < most; i++) {
        stepper.stepTo(i * dt);
        const State &now = integrator.getState();
        y[0] = lower.getAngle(now);
        y[1] = y[0] + upper.getAngle(now);                                 /* absolute angles */
        tip = std::fmax(tip, std::fabs(std::sin(y[0]) + std::sin(y[1])));
        modald_push(s, y);                                                 /* STREAM */
        if (write(3, y, sizeof y) < 0) { }
        if (modald_verdict(s) == MODALD_UNSTABLE)
            break;
        if (pace > 0)
            usleep(static_cast<useconds_t>(1e6 * pace));
    }
    int verdict = modald_verdict(s);
    modald_close(s);                                                       /* STREAM */
    std::printf("steps %ld tip %.17g verdict %d\n", i, tip, verdict);
    return 0;
}
