// Vectors and rotations: as much linear algebra as the peers need. Angles in radians, rotations active.
#pragma once

#include <cmath>

struct Vec3 {
    double x, y, z;
};

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, const Vec3& a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }
inline Vec3 load(const double* p) { return {p[0], p[1], p[2]}; }

// Three rows.
struct Mat3 {
    Vec3 r0, r1, r2;
};

inline Vec3 operator*(const Mat3& m, const Vec3& v) { return {dot(m.r0, v), dot(m.r1, v), dot(m.r2, v)}; }
inline Vec3 transpose_times(const Mat3& m, const Vec3& v) { return v.x * m.r0 + v.y * m.r1 + v.z * m.r2; }
inline Mat3 operator*(const Mat3& a, const Mat3& b) {
    return {transpose_times(b, a.r0), transpose_times(b, a.r1), transpose_times(b, a.r2)};
}

// The sine and cosine of one angle: computed once, used for vectors and for matrices.
struct Angle {
    double sin, cos;
    explicit Angle(double radians) : sin(std::sin(radians)), cos(std::cos(radians)) {}
    Angle(double sine, double cosine) : sin(sine), cos(cosine) {}
};

// Rx(a) v, Ry(a) v and their inverses, without forming a matrix.
inline Vec3 turn_x(const Angle& a, const Vec3& v) { return {v.x, a.cos * v.y - a.sin * v.z, a.sin * v.y + a.cos * v.z}; }
inline Vec3 turn_y(const Angle& a, const Vec3& v) { return {a.cos * v.x + a.sin * v.z, v.y, a.cos * v.z - a.sin * v.x}; }
inline Vec3 unturn_x(const Angle& a, const Vec3& v) { return turn_x({-a.sin, a.cos}, v); }
inline Vec3 unturn_y(const Angle& a, const Vec3& v) { return turn_y({-a.sin, a.cos}, v); }

inline Mat3 rotation_x(const Angle& a) { return {{1, 0, 0}, {0, a.cos, -a.sin}, {0, a.sin, a.cos}}; }
inline Mat3 rotation_y(const Angle& a) { return {{a.cos, 0, a.sin}, {0, 1, 0}, {-a.sin, 0, a.cos}}; }
inline Mat3 rotation_z(const Angle& a) { return {{a.cos, -a.sin, 0}, {a.sin, a.cos, 0}, {0, 0, 1}}; }

// Rx(omega) Ry(phi) Rz(kappa).
inline Mat3 rotation_xyz(const double* angles_rad) {
    return rotation_x(Angle(angles_rad[0])) * rotation_y(Angle(angles_rad[1])) * rotation_z(Angle(angles_rad[2]));
}

// Unit quaternion, scalar last.
struct Quaternion {
    double x, y, z, w;
};

inline Mat3 matrix(const Quaternion& q) {
    const double xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
    const double xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
    const double wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
    return {{1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)},
            {2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)},
            {2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)}};
}

// The shorter way from a (weight 0) to b (weight 1) at even angular rate; one acos and one sincos.
inline Quaternion slerp(const Quaternion& a, Quaternion b, double weight) {
    double cosine = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
    if (cosine < 0) {
        cosine = -cosine;
        b = {-b.x, -b.y, -b.z, -b.w};
    }
    double of_a = 1 - weight, of_b = weight;
    if (cosine < 1 - 1e-15) {
        const double angle = std::acos(cosine);
        const Angle part(weight * angle);
        of_b = part.sin / std::sqrt((1 - cosine) * (1 + cosine));
        of_a = part.cos - cosine * of_b;
    }
    return {of_a * a.x + of_b * b.x, of_a * a.y + of_b * b.y, of_a * a.z + of_b * b.z, of_a * a.w + of_b * b.w};
}
