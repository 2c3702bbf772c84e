// When, and at which sample, the whiskbroom scanner saw a ground point.
#include <cmath>
#include <cstdint>
#include <limits>

#include "whiskbroom.hpp"

namespace {

// The two ends of the window included. Seven leave 99.9 % of all points within 1e-12 s; the kinks of linearly interpolated
// POS cost the others up to 1e-8 s, 6e-5 px at a scan rate of 33 deg/s.
constexpr int EVALUATIONS = 7;

struct View {
    double time_s, miss, sample_px;
};

// How far the point lies off the detector line at time t: tan of half the angle, positive on the side of +y. Unlike the
// image coordinate it stays finite when the point is beside or behind the camera, and is nearly linear in time.
bool look(Scanner& scanner, const Whiskbroom& w, const Vec3& point, double t, View* view) {
    Moment moment;
    if (!scanner.at(t, &moment)) return false;
    const Vec3 q = scanner.camera_point(moment, point);
    const double depth = -q.z;
    *view = {t, w.swing * q.y / (std::sqrt(q.y * q.y + depth * depth) + depth), w.focal_px * q.x / depth};
    return true;
}

// Where a secant through the two last views crosses zero.
double crossing(const View& a, const View& b) { return b.time_s - b.miss * (b.time_s - a.time_s) / (b.miss - a.miss); }

// A secant that may not leave the bracket; false where the window does not bracket the point or is not covered.
bool find(Scanner& scanner, const Whiskbroom& w, const Vec3& point, double t0, double t1, View* found) {
    View previous, current;
    if (!look(scanner, w, point, t0, &previous) || !look(scanner, w, point, t1, &current)) return false;
    if ((previous.miss < 0) == (current.miss < 0)) return false;
    const bool rising = previous.miss < current.miss;
    double low = t0, high = t1;
    for (int k = 2; k < EVALUATIONS; ++k) {
        double t = crossing(previous, current);
        if (t == current.time_s) break;
        if (!(low < t && t < high)) t = 0.5 * (low + high);
        View next;
        if (!look(scanner, w, point, t, &next)) return false;
        ((next.miss < 0) == rising ? low : high) = t;
        previous = current;
        current = next;
        if (next.miss == 0) break;
    }
    // A last secant step costs no evaluation: the sample follows it linearly.
    *found = current;
    if (current.miss != 0 && current.miss != previous.miss) {
        const double t = crossing(previous, current);
        const double part = (t - current.time_s) / (current.time_s - previous.time_s);
        *found = {t, 0, current.sample_px + part * (current.sample_px - previous.sample_px)};
    }
    return true;
}

}  // namespace

// point_m: (n, 3) ECEF. time_s, sample_px: (n,), NaN where the point is not seen between t0_s and t1_s.
extern "C" void ground_to_image(const Whiskbroom* instrument, std::int64_t n, const double* point_m, double t0_s, double t1_s,
                                double* time_s, double* sample_px) {
    Scanner scanner(*instrument);
    for (std::int64_t i = 0; i < n; ++i) {
        View view;
        if (!find(scanner, *instrument, load(point_m + 3 * i), t0_s, t1_s, &view)) {
            view.time_s = view.sample_px = std::numeric_limits<double>::quiet_NaN();
        }
        time_s[i] = view.time_s;
        sample_px[i] = view.sample_px;
    }
}
