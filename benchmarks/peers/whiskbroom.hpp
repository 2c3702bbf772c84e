// The whiskbroom scanner `haian`, written for this one instrument.
//
// From the Earth down: POS pose ecef_from_body; axes (x, -y, -z); lever arm u_gps; R_pos; Rx(scan) Ry(pitch);
// lever arm u_sen; R_sen; line camera looking along -z with its detector along x.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "geometry.hpp"

extern "C" {
// Samples in time, linear between neighbours unless they lie further apart than max_gap_s. Layout shared with peers/__init__.py.
struct Times {
    std::int64_t count;
    const double* time_s;
    double max_gap_s;
};

struct Whiskbroom {
    Times pos;
    const double* position_m;       // (pos.count, 3) ECEF
    const double* quaternion_xyzw;  // (pos.count, 4) ecef_from_body
    Times scan;
    const double* scan_rad;
    Times pitch;
    const double* pitch_rad;
    double u_gps_m[3];
    double angles_pos_rad[3];  // of this swing
    double u_sen_m[3];
    double angles_sen_rad[3];
    double focal_px;
    double swing;  // +1 left, -1 right: the image coordinate across the line is swing * y
};
}

// Where a time lies between samples: sample index and the weight of the next one.
struct Between {
    std::int64_t index;
    double weight;
};

// Finds the interval of a time. Queries come in time order or jump within one image, and samples are nearly even, so it
// extrapolates from the interval found last and searches only where that fails.
class Clock {
public:
    explicit Clock(const Times& times) : times_(times), last_(0) {}

    // False: t lies outside the samples or in a gap between them.
    bool find(double t, Between* found) {
        const double* time = times_.time_s;
        const std::int64_t end = times_.count - 2;
        std::int64_t i = last_;
        if (!(time[i] <= t && t <= time[i + 1])) {
            const double steps = (t - time[i]) / (time[i + 1] - time[i]);
            i = static_cast<std::int64_t>(std::clamp(i + std::floor(steps), 0.0, static_cast<double>(end)));
            if (i > 0 && t < time[i]) --i;
            if (i < end && t > time[i + 1]) ++i;
            if (!(time[i] <= t && t <= time[i + 1])) {
                if (!(time[0] <= t && t <= time[end + 1])) return false;
                i = std::min<std::int64_t>(std::upper_bound(time, time + times_.count, t) - time - 1, end);
            }
            last_ = i;
        }
        const double width = time[i + 1] - time[i];
        *found = {i, (t - time[i]) / width};
        return width <= times_.max_gap_s;
    }

private:
    const Times& times_;
    std::int64_t last_;
};

// Everything that changes from shot to shot.
struct Moment {
    Vec3 antenna_m;
    Mat3 ecef_from_platform;  // x forward, y left, z up
    Angle scan{0, 1}, pitch{0, 1};
};

class Scanner {
public:
    explicit Scanner(const Whiskbroom& w)
        : w_(w), pos_(w.pos), scan_(w.scan), pitch_(w.pitch), u_gps_(load(w.u_gps_m)), u_sen_(load(w.u_sen_m)),
          r_pos_(rotation_xyz(w.angles_pos_rad)), r_sen_(rotation_xyz(w.angles_sen_rad)) {}

    bool at(double t, Moment* moment) {
        Between pos, scan, pitch;
        if (!(pos_.find(t, &pos) && scan_.find(t, &scan) && pitch_.find(t, &pitch))) return false;
        const double* x = w_.position_m + 3 * pos.index;
        const double* q = w_.quaternion_xyzw + 4 * pos.index;
        moment->antenna_m = load(x) + pos.weight * (load(x + 3) - load(x));
        const Mat3 r = matrix(slerp({q[0], q[1], q[2], q[3]}, {q[4], q[5], q[6], q[7]}, pos.weight));
        moment->ecef_from_platform = {{r.r0.x, -r.r0.y, -r.r0.z}, {r.r1.x, -r.r1.y, -r.r1.z}, {r.r2.x, -r.r2.y, -r.r2.z}};
        moment->scan = Angle(between(w_.scan_rad, scan));
        moment->pitch = Angle(between(w_.pitch_rad, pitch));
        return true;
    }

    // The projection centre, and the direction of a pixel on the detector line, both in ECEF.
    void ray(const Moment& m, double sample_px, Vec3* origin, Vec3* direction) const {
        const Vec3 look = r_sen_ * Vec3{sample_px, 0, -w_.focal_px};
        *origin = m.antenna_m + m.ecef_from_platform * (u_gps_ + r_pos_ * turn_x(m.scan, turn_y(m.pitch, u_sen_)));
        *direction = m.ecef_from_platform * (r_pos_ * turn_x(m.scan, turn_y(m.pitch, look)));
    }

    // An ECEF point in the camera frame.
    Vec3 camera_point(const Moment& m, const Vec3& point) const {
        const Vec3 platform = transpose_times(m.ecef_from_platform, point - m.antenna_m);
        const Vec3 scanner = unturn_y(m.pitch, unturn_x(m.scan, transpose_times(r_pos_, platform - u_gps_)));
        return transpose_times(r_sen_, scanner - u_sen_);
    }

private:
    static double between(const double* value, const Between& b) {
        return value[b.index] + b.weight * (value[b.index + 1] - value[b.index]);
    }

    const Whiskbroom& w_;
    Clock pos_, scan_, pitch_;
    Vec3 u_gps_, u_sen_;
    Mat3 r_pos_, r_sen_;
};
