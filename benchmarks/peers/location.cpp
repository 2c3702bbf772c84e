// Where a fixed target is: an extended Kalman filter over the looks of each run, one scalar filter after the other.
//
// The state is the target's offset from the first guess in ECEF axes. A look is what was recorded of it, ten numbers in this order:
// latitude, longitude, height (WGS-84), roll, pitch, heading, gimbal roll beta, gimbal pitch alpha, pixel m, pixel n. With
//     u = Ry(alpha)^T Rx(beta)^T Rx(roll)^T Ry(pitch)^T Rz(heading)^T ned_from_ecef (target - platform)
// the pixel is focal_px (u_x / u_z, u_y / u_z).
#include <cstdint>
#include <thread>
#include <vector>

#include "earth.hpp"

extern "C" {
// Layout shared with peers/location.py.
struct Looks {
    std::int64_t runs;
    std::int64_t count;
    const double* look;  // (runs, count, 10)
    double guess_m[3];   // ECEF
    double covariance_m2[9];
    double focal_px;
    double pixel_sigma_px;
    double position_sigma_m[3];    // along the body's axes
    double attitude_sigma_rad[3];  // small turns about the body's axes
    double gimbal_sigma_rad[2];    // about x after Rx(beta), about y after Ry(alpha)
};
}

namespace {

constexpr int NUMBERS = 10;

inline Vec3 turn_z(const Angle& a, const Vec3& v) { return {a.cos * v.x - a.sin * v.y, a.sin * v.x + a.cos * v.y, v.z}; }

// Two components, m and n, of what is measured; a symmetric 2x2 and 3x3.
struct Pair {
    double m, n;
};
struct Sym2 {
    double mm, mn, nn;
    void add(double variance, const Pair& v) {
        mm += variance * v.m * v.m;
        mn += variance * v.m * v.n;
        nn += variance * v.n * v.n;
    }
};
struct Sym3 {
    double xx, xy, xz, yy, yz, zz;
};
inline Vec3 operator*(const Sym3& s, const Vec3& v) {
    return {s.xx * v.x + s.xy * v.y + s.xz * v.z, s.xy * v.x + s.yy * v.y + s.yz * v.z, s.xz * v.x + s.yz * v.y + s.zz * v.z};
}

// Where the camera was and looked, before the target is known.
struct Pose {
    Mat3 camera_from_ecef;
    Vec3 platform_from_guess;

    Pose(const double* look, const Angle& alpha, const Vec3& guess) {
        const Angle lat(look[0]), lon(look[1]), pitch(look[4]), heading(look[5]);
        const Angle roll(look[3] + look[6]);  // the platform's and the gimbal's turn follow each other about one axis
        const Angle ned_from_meridian(lat.cos, -lat.sin);  // x outwards, y east, z along the Earth's axis; a turn about y
        const auto to_ecef = [&](const Vec3& body) {
            return turn_z(lon, unturn_y(ned_from_meridian, turn_z(heading, turn_y(pitch, body))));
        };
        camera_from_ecef = {to_ecef({alpha.cos, roll.sin * alpha.sin, -roll.cos * alpha.sin}), to_ecef({0, roll.cos, roll.sin}),
                            to_ecef({alpha.sin, -roll.sin * alpha.cos, roll.cos * alpha.cos})};
        const double normal = wgs84::a / std::sqrt(1 - wgs84::e2 * lat.sin * lat.sin), height = look[2];
        const double out = (normal + height) * lat.cos;
        platform_from_guess = Vec3{out * lon.cos, out * lon.sin, ((1 - wgs84::e2) * normal + height) * lat.sin} - guess;
    }
};

// The covariance of a pixel at (a, b) focal lengths, from registration and all recorded errors. A small motion (turn, shift) of
// a joint moves the pixel by -H (turn x p + shift); no lever arm lies between the joints, so p is u turned and the signs square.
inline Sym2 noise(const Looks& p, const Angle& alpha, double beta_rad, double a, double b, double per_m) {
    const Angle beta(beta_rad);
    const Vec3 x = {alpha.cos, 0, alpha.sin};  // the body's axes in the camera's frame; x is the gimbal's roll axis as well
    const Vec3 y = {beta.sin * alpha.sin, beta.cos, -beta.sin * alpha.cos};
    const Vec3 z = {-beta.cos * alpha.sin, beta.sin, beta.cos * alpha.cos};
    const double aa = 1 + a * a, ab = a * b, bb = 1 + b * b, f = p.focal_px;
    const auto turn = [&](const Vec3& w) { return Pair{aa * w.y - ab * w.x - b * w.z, ab * w.y - bb * w.x + a * w.z}; };
    const auto shift = [&](const Vec3& w) { return Pair{w.x - a * w.z, w.y - b * w.z}; };
    const auto square = [](double sigma) { return sigma * sigma; };
    const double* position = p.position_sigma_m;
    const double* attitude = p.attitude_sigma_rad;
    const double* gimbal = p.gimbal_sigma_rad;
    // The three axes are orthonormal: equal sigmas along all of them give (1 + a a, a b, 1 + b b), the rest is added.
    const double scale = square(per_m), along_x = scale * square(position[0]);
    Sym2 sum = {along_x * aa, along_x * ab, along_x * bb};
    sum.add(scale * square(position[1]) - along_x, shift(y));
    sum.add(scale * square(position[2]) - along_x, shift(z));
    Sym2 turned = {0, 0, 0};
    turned.add(square(attitude[0]) + square(gimbal[0]), turn(x));
    turned.add(square(attitude[1]), turn(y));
    turned.add(square(attitude[2]), turn(z));
    turned.add(square(gimbal[1]), Pair{aa, ab});
    const double ff = f * f, pixel = square(p.pixel_sigma_px);
    return {pixel + sum.mm + ff * turned.mm, sum.mn + ff * turned.mn, pixel + sum.nn + ff * turned.nn};
}

template <bool full>
void filter(const Looks& p, std::int64_t first, std::int64_t last, double* offset_m, double* covariance_m2) {
    const Vec3 guess = load(p.guess_m);
    const double* c = p.covariance_m2;
    const double pixel = p.pixel_sigma_px * p.pixel_sigma_px;
    for (std::int64_t run = first; run < last; ++run) {
        Vec3 x = {0, 0, 0};
        Sym3 P = {c[0], c[1], c[2], c[4], c[5], c[8]};
        const double* look = p.look + NUMBERS * p.count * run;
        for (const double* end = look + NUMBERS * p.count; look < end; look += NUMBERS) {
            const Angle alpha(look[7]);
            const Pose pose(look, alpha, guess);
            const Vec3 u = pose.camera_from_ecef * (x - pose.platform_from_guess);
            const double inverse_depth = 1 / u.z, per_m = p.focal_px * inverse_depth;
            const double a = u.x * inverse_depth, b = u.y * inverse_depth;
            const Vec3 hm = per_m * (pose.camera_from_ecef.r0 - a * pose.camera_from_ecef.r2);
            const Vec3 hn = per_m * (pose.camera_from_ecef.r1 - b * pose.camera_from_ecef.r2);
            const Sym2 R = full ? noise(p, alpha, look[6], a, b, per_m) : Sym2{pixel, 0, pixel};

            const Vec3 pm = P * hm, pn = P * hn;
            const Sym2 S = {dot(hm, pm) + R.mm, dot(hm, pn) + R.mn, dot(hn, pn) + R.nn};
            const double inverse = 1 / (S.mm * S.nn - S.mn * S.mn);
            const double im = inverse * S.nn, in = inverse * S.mm, cross = -inverse * S.mn;
            const Vec3 km = im * pm + cross * pn, kn = cross * pm + in * pn;
            x = x + (look[8] - p.focal_px * a) * km + (look[9] - p.focal_px * b) * kn;

            // Joseph's form (I - K H) P (I - K H)^T + K R K^T, as M - (M H^T - K R) K^T with M = P - K (H P).
            const Vec3 mx = Vec3{P.xx, P.xy, P.xz} - km.x * pm - kn.x * pn;
            const Vec3 my = Vec3{P.xy, P.yy, P.yz} - km.y * pm - kn.y * pn;
            const Vec3 mz = Vec3{P.xz, P.yz, P.zz} - km.z * pm - kn.z * pn;
            Vec3 left_m = Vec3{dot(mx, hm), dot(my, hm), dot(mz, hm)} - R.mm * km;
            Vec3 left_n = Vec3{dot(mx, hn), dot(my, hn), dot(mz, hn)} - R.nn * kn;
            if (full) {
                left_m = left_m - R.mn * kn;
                left_n = left_n - R.mn * km;
            }
            P = {mx.x - left_m.x * km.x - left_n.x * kn.x, mx.y - left_m.x * km.y - left_n.x * kn.y,
                 mx.z - left_m.x * km.z - left_n.x * kn.z, my.y - left_m.y * km.y - left_n.y * kn.y,
                 my.z - left_m.y * km.z - left_n.y * kn.z, mz.z - left_m.z * km.z - left_n.z * kn.z};
        }
        double* to = offset_m + 3 * run;
        to[0] = x.x, to[1] = x.y, to[2] = x.z;
        const double full_P[9] = {P.xx, P.xy, P.xz, P.xy, P.yy, P.yz, P.xz, P.yz, P.zz};
        for (int i = 0; i < 9; ++i) covariance_m2[9 * run + i] = full_P[i];
    }
}

}  // namespace

// full: whether the measurement covariance holds the recorded errors too, or registration alone. The runs are split evenly over
// the threads, of which the caller's is one. offset_m: (runs, 3). covariance_m2: (runs, 3, 3).
extern "C" void location(const Looks* looks, int full, int threads, double* offset_m, double* covariance_m2) {
    const auto part = [=](int k) {
        const std::int64_t first = looks->runs * k / threads, last = looks->runs * (k + 1) / threads;
        (full ? filter<true> : filter<false>)(*looks, first, last, offset_m, covariance_m2);
    };
    std::vector<std::thread> others;
    for (int k = 1; k < threads; ++k) others.emplace_back(part, k);
    part(0);
    for (std::thread& other : others) other.join();
}
