// Where a ray meets the WGS-84 surface of constant geodetic height.
#pragma once

#include <cmath>
#include <limits>

#include "geometry.hpp"

namespace wgs84 {
constexpr double a = 6378137.0;
constexpr double f = 1 / 298.257223563;
constexpr double b = a * (1 - f);
constexpr double e2 = f * (2 - f);
constexpr double ep2 = e2 / (1 - e2);
}  // namespace wgs84

struct Height {
    double height_m;
    Vec3 up;  // the unit normal of the ellipsoid below the point: the gradient of the height
};

// Geodetic height by one pass of Bowring's formula, without angles and without a root of p: the cosine of the latitude is
// p * out and its sine z * north, where out and north depend on p^2 and z^2. Exact to rounding for terrestrial heights.
inline Height geodetic_height(const Vec3& point) {
    using namespace wgs84;
    const double pp = point.x * point.x + point.y * point.y, zz = point.z * point.z;
    const double w = 1 / std::sqrt(b * b * pp + a * a * zz);
    const double www = w * w * w;
    double out = 1 - e2 * a * b * b * b * (pp * www);
    double north = 1 + ep2 * b * a * a * a * (zz * www);
    const double length = 1 / std::sqrt(pp * out * out + zz * north * north);
    out *= length;
    north *= length;
    const double height = pp * out + zz * north - a * std::sqrt(1 - e2 * zz * north * north);
    return {height, {point.x * out, point.y * out, point.z * north}};
}

// First point of the ray whose geodetic height is height_m, seen from above; NaN where the ray misses.
//
// The ellipsoid with both axes longer by height_m is within centimetres of that surface; Newton on the geodetic height
// does the rest. Its error after a step of length s is about s^2 / (2 * 6.4e6 m * cos(off nadir)), hence the stop.
inline Vec3 meet_height(const Vec3& origin, const Vec3& direction, double height_m) {
    const double a = 1 / (wgs84::a + height_m), b = 1 / (wgs84::b + height_m);
    const Vec3 o = {origin.x * a, origin.y * a, origin.z * b};
    const Vec3 d = {direction.x * a, direction.y * a, direction.z * b};
    const double dd = dot(d, d), od = dot(o, d), oo = dot(o, o) - 1;
    const double discriminant = od * od - dd * oo;
    if (!(discriminant >= 0 && od < 0)) {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        return {nan, nan, nan};
    }
    double along = oo / (std::sqrt(discriminant) - od);  // the nearer root, without cancellation
    const double ray_length = norm(direction);
    for (int k = 0; k < 4; ++k) {
        const Height here = geodetic_height(origin + along * direction);
        const double step = (height_m - here.height_m) / dot(here.up, direction);
        along += step;
        if (std::abs(step) * ray_length < 0.1) break;
    }
    return origin + along * direction;
}
