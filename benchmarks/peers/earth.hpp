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

// Geodetic height by one step of Bowring's formula, in sines and cosines only: below 1e-9 m for terrestrial heights.
inline Height geodetic_height(const Vec3& point) {
    const double p = std::sqrt(point.x * point.x + point.y * point.y);
    const double u = wgs84::b * p, v = wgs84::a * point.z;  // reduced latitude: atan2(v, u)
    const double scale = 1 / std::sqrt(u * u + v * v);
    const double cos_beta = u * scale, sin_beta = v * scale;
    const double north = point.z + wgs84::ep2 * wgs84::b * sin_beta * sin_beta * sin_beta;
    const double out = p - wgs84::e2 * wgs84::a * cos_beta * cos_beta * cos_beta;
    const double length = 1 / std::sqrt(north * north + out * out);
    const double sin_lat = north * length, cos_lat = out * length;
    const double height = p * cos_lat + point.z * sin_lat - wgs84::a * std::sqrt(1 - wgs84::e2 * sin_lat * sin_lat);
    const double per_p = cos_lat / p;
    return {height, {point.x * per_p, point.y * per_p, sin_lat}};
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
