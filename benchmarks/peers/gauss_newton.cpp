// Calibration of the whiskbroom scanner: 15 unknowns with priors, a fixed number of Gauss-Newton steps.
//
// Unknowns, in this order: u_gps (3), R_pos of the left swing (3), of the right swing (3), u_sen (3), R_sen (3).
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "geometry.hpp"

extern "C" {
// What was recorded and measured, arrays of n observations. Layout shared with peers/__init__.py.
struct Observations {
    std::int64_t count;
    const double* ecef_from_platform;  // (n, 3, 3) POS attitude, then x forward, y left, z up
    const double* antenna_m;           // (n, 3) ECEF
    const double* scan_sin_cos;        // (n, 2)
    const double* pitch_sin_cos;       // (n, 2)
    const std::int32_t* right;         // (n,) 0 left, 1 right swing
    const double* point_m;             // (n, 3) ECEF
    const double* pixel_px;            // (n, 2) sample, offset across the line
    const double* sigma_px;            // (n, 2)
    double focal_px;
};
}

namespace {

constexpr int UNKNOWNS = 15;
constexpr int ACTING = 12;  // on one observation: the other swing's R_pos does not

using Vector = std::array<double, UNKNOWNS>;
using Matrix = std::array<Vector, UNKNOWNS>;

// Sums over the observations of one swing of [J | r]^T [J | r]: dense, so that the inner loops have fixed lengths.
using Sums = std::array<std::array<double, ACTING + 1>, ACTING + 1>;

// Which unknown each column of a swing's Jacobian belongs to.
constexpr int ACTS[2][ACTING] = {{0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14}, {0, 1, 2, 6, 7, 8, 9, 10, 11, 12, 13, 14}};

// A rotation by three angles, and the axes about which each of them turns it (in the outer frame).
struct Rotation {
    Mat3 matrix;
    std::array<Vec3, 3> axis;

    explicit Rotation(const double* angles_rad) {
        const Mat3 x = rotation_x(Angle(angles_rad[0]));
        const Mat3 xy = x * rotation_y(Angle(angles_rad[1]));
        matrix = xy * rotation_z(Angle(angles_rad[2]));
        axis = {Vec3{1, 0, 0}, {x.r0.y, x.r1.y, x.r2.y}, {xy.r0.z, xy.r1.z, xy.r2.z}};
    }
};

// Solves N x = rhs for a symmetric positive definite N given by its lower triangle; false where it is not.
bool solve(Matrix n, Vector rhs, Vector* x) {
    for (int j = 0; j < UNKNOWNS; ++j) {
        double d = n[j][j];
        for (int k = 0; k < j; ++k) d -= n[j][k] * n[j][k];
        if (!(d > 0)) return false;
        n[j][j] = std::sqrt(d);
        for (int i = j + 1; i < UNKNOWNS; ++i) {
            double s = n[i][j];
            for (int k = 0; k < j; ++k) s -= n[i][k] * n[j][k];
            n[i][j] = s / n[j][j];
        }
    }
    for (int i = 0; i < UNKNOWNS; ++i) {
        for (int k = 0; k < i; ++k) rhs[i] -= n[i][k] * rhs[k];
        rhs[i] /= n[i][i];
    }
    for (int i = UNKNOWNS - 1; i >= 0; --i) {
        for (int k = i + 1; k < UNKNOWNS; ++k) rhs[i] -= n[k][i] * rhs[k];
        rhs[i] /= n[i][i];
    }
    *x = rhs;
    return true;
}

}  // namespace

// prior_mean, prior_sigma, value: (15,) metres and radians; the start is the prior mean. Returns 0, or 1 where the normal
// matrix was not positive definite.
extern "C" int gauss_newton(const Observations* observed, const double* prior_mean, const double* prior_sigma, int steps,
                            double* value) {
    const Observations& o = *observed;
    std::vector<Vec3> platform_point(o.count);  // no unknown moves it
    for (std::int64_t i = 0; i < o.count; ++i) {
        const double* m = o.ecef_from_platform + 9 * i;
        const Mat3 rotation = {load(m), load(m + 3), load(m + 6)};
        platform_point[i] = transpose_times(rotation, load(o.point_m + 3 * i) - load(o.antenna_m + 3 * i));
    }
    for (int k = 0; k < UNKNOWNS; ++k) value[k] = prior_mean[k];

    for (int step = 0; step < steps; ++step) {
        const Vec3 u_gps = load(value), u_sen = load(value + 9);
        const Rotation pos[2] = {Rotation(value + 3), Rotation(value + 6)};
        const Rotation sen(value + 12);

        // Normal equations for the whitened correction: each column scaled by its prior sigma, so the prior adds the identity.
        Sums sums[2] = {};
        for (std::int64_t i = 0; i < o.count; ++i) {
            const int swing = o.right[i];
            const Angle scan(o.scan_sin_cos[2 * i], o.scan_sin_cos[2 * i + 1]);
            const Angle pitch(o.pitch_sin_cos[2 * i], o.pitch_sin_cos[2 * i + 1]);
            const Vec3 from_gps = platform_point[i] - u_gps;
            const Vec3 scanned = unturn_y(pitch, unturn_x(scan, transpose_times(pos[swing].matrix, from_gps)));
            const Vec3 from_sen = scanned - u_sen;
            const Vec3 q = transpose_times(sen.matrix, from_sen);

            // d(sample, offset) / dq
            const double depth = -q.z, per = o.focal_px / depth, sign = swing == 0 ? 1.0 : -1.0;
            const double x = per * q.x, y = per * q.y;
            const Vec3 dq[2] = {{per, 0, x / depth}, {0, sign * per, sign * y / depth}};
            const double residual[2] = {o.pixel_px[2 * i] - x, o.pixel_px[2 * i + 1] - sign * y};

            const int* acts = ACTS[swing];
            for (int row = 0; row < 2; ++row) {
                // The row carried outwards, frame by frame: what a shift of that frame's point does to the pixel.
                const double weight = 1 / o.sigma_px[2 * i + row];
                const Vec3 at_sen = sen.matrix * (weight * dq[row]);
                const Vec3 at_gps = pos[swing].matrix * turn_x(scan, turn_y(pitch, at_sen));
                // A turn by d about axis w moves R^T p by R^T (p x w) d, hence the row times it is (row x p) . w d.
                const Vec3 turn_gps = cross(at_gps, from_gps), turn_sen = cross(at_sen, from_sen);
                double j[ACTING + 1] = {-at_gps.x, -at_gps.y, -at_gps.z, dot(turn_gps, pos[swing].axis[0]),
                                        dot(turn_gps, pos[swing].axis[1]), dot(turn_gps, pos[swing].axis[2]),
                                        -at_sen.x, -at_sen.y, -at_sen.z, dot(turn_sen, sen.axis[0]),
                                        dot(turn_sen, sen.axis[1]), dot(turn_sen, sen.axis[2]), weight * residual[row]};
                for (int a = 0; a < ACTING; ++a) j[a] *= prior_sigma[acts[a]];
                for (int a = 0; a <= ACTING; ++a) {
                    for (int b = 0; b <= ACTING; ++b) sums[swing][a][b] += j[a] * j[b];
                }
            }
        }
        Matrix normal{};
        Vector rhs{};
        for (int swing = 0; swing < 2; ++swing) {
            for (int a = 0; a < ACTING; ++a) {
                rhs[ACTS[swing][a]] += sums[swing][a][ACTING];
                for (int b = 0; b <= a; ++b) normal[ACTS[swing][a]][ACTS[swing][b]] += sums[swing][a][b];
            }
        }
        for (int k = 0; k < UNKNOWNS; ++k) {
            normal[k][k] += 1;
            rhs[k] += (prior_mean[k] - value[k]) / prior_sigma[k];
        }
        Vector correction;
        if (!solve(normal, rhs, &correction)) return 1;
        for (int k = 0; k < UNKNOWNS; ++k) value[k] += prior_sigma[k] * correction[k];
    }
    return 0;
}
