// Pixels of the whiskbroom scanner to the ground of one geodetic height.
#include <cstdint>
#include <limits>

#include "earth.hpp"
#include "whiskbroom.hpp"

// time_s, sample_px: (n,). point_m: (n, 3) ECEF, NaN where the time is not covered or the ray misses.
extern "C" void image_to_ground(const Whiskbroom* instrument, std::int64_t n, const double* time_s, const double* sample_px,
                                double height_m, double* point_m) {
    Scanner scanner(*instrument);
    for (std::int64_t i = 0; i < n; ++i) {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        Vec3 ground = {nan, nan, nan};
        Moment moment;
        if (scanner.at(time_s[i], &moment)) {
            Vec3 origin, direction;
            scanner.ray(moment, sample_px[i], &origin, &direction);
            ground = meet_height(origin, direction, height_m);
        }
        point_m[3 * i] = ground.x;
        point_m[3 * i + 1] = ground.y;
        point_m[3 * i + 2] = ground.z;
    }
}
