// Calibration of the whiskbroom scanner with Eigen: 15 unknowns with priors, a fixed number of Gauss-Newton steps.
//
// Unknowns, in this order: u_gps (3), R_pos of the left swing (3), of the right swing (3), u_sen (3), R_sen (3).
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <vector>

extern "C" {
// What was recorded and measured: arrays of n observations for each of the lanes. Layout shared with peers/__init__.py.
struct Observations {
    std::int64_t lanes;
    std::int64_t count;
    const double* ecef_from_platform;  // (lanes, n, 3, 3) POS attitude, then x forward, y left, z up
    const double* antenna_m;           // (lanes, n, 3) ECEF
    const double* scan_sin_cos;        // (lanes, n, 2)
    const double* pitch_sin_cos;       // (lanes, n, 2)
    const std::int32_t* right;         // (lanes, n) 0 left, 1 right swing
    const double* point_m;             // (lanes, n, 3) ECEF
    const double* pixel_px;            // (lanes, n, 2) sample, offset across the line
    const double* sigma_px;            // (lanes, n, 2)
    double focal_px;
};
}

namespace {

using Eigen::Matrix3d, Eigen::Vector2d, Eigen::Vector3d;

constexpr int UNKNOWNS = 15;
constexpr int ACTING = 12;  // on one observation: the other swing's R_pos does not
using Vector = Eigen::Matrix<double, UNKNOWNS, 1>;
using Matrix = Eigen::Matrix<double, UNKNOWNS, UNKNOWNS>;

// Which unknown each row of a swing's Jacobian belongs to.
constexpr int ACTS[2][ACTING] = {{0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14}, {0, 1, 2, 6, 7, 8, 9, 10, 11, 12, 13, 14}};

// One observation, with what no unknown changes already computed.
struct Seen {
    int swing;
    double sign;
    Vector3d point;  // from the antenna, in the platform's axes
    Matrix3d turn;   // Rx(scan) Ry(pitch)
    Vector2d pixel, weight;

    Seen(const Observations& o, std::int64_t i)
        : swing(o.right[i]),
          sign(swing == 0 ? 1 : -1),
          pixel(o.pixel_px + 2 * i),
          weight(Vector2d(o.sigma_px + 2 * i).cwiseInverse()) {
        using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
        const Eigen::Map<const RowMajor> rotation(o.ecef_from_platform + 9 * i);
        point = rotation.transpose() * (Vector3d(o.point_m + 3 * i) - Vector3d(o.antenna_m + 3 * i));
        const double ss = o.scan_sin_cos[2 * i], cs = o.scan_sin_cos[2 * i + 1];
        const double sp = o.pitch_sin_cos[2 * i], cp = o.pitch_sin_cos[2 * i + 1];
        turn << cp, 0, sp, ss * sp, cs, -ss * cp, -cs * sp, ss, cs * cp;
    }
};

// Rx(omega) Ry(phi) Rz(kappa), and as rows the axes about which each angle turns it (in the outer frame).
struct Rotation {
    Matrix3d matrix, axes;

    explicit Rotation(const Vector3d& angles_rad) {
        using Eigen::AngleAxisd;
        const Matrix3d x = AngleAxisd(angles_rad[0], Vector3d::UnitX()).toRotationMatrix();
        const Matrix3d xy = x * AngleAxisd(angles_rad[1], Vector3d::UnitY()).toRotationMatrix();
        matrix = xy * AngleAxisd(angles_rad[2], Vector3d::UnitZ()).toRotationMatrix();
        axes << Vector3d::UnitX().transpose(), x.col(1).transpose(), xy.col(2).transpose();
    }
};

// Rows of one swing's [J | r]^T, a column for each measured coordinate: one product then makes the normal equations.
using Rows = Eigen::Matrix<double, ACTING + 1, Eigen::Dynamic>;

class Calibration {
    Vector mean_, sigma_;
    double focal_px_;
    std::vector<Seen> seen_;
    Rows rows_[2];

   public:
    Calibration(const Observations& o, const double* mean, const double* sigma)
        : mean_(mean), sigma_(sigma), focal_px_(o.focal_px) {
        seen_.reserve(o.count);
        for (Rows& rows : rows_) rows.resize(Eigen::NoChange, 2 * o.count);
    }

    // The solution from the prior mean; NaN where a normal matrix was not positive definite.
    Vector solve(const Observations& o, std::int64_t lane, int steps) {
        seen_.clear();
        for (std::int64_t i = lane * o.count; i < (lane + 1) * o.count; ++i) seen_.emplace_back(o, i);
        Vector value = mean_;
        for (int step = 0; step < steps; ++step) {
            // For the whitened correction: rows and columns scaled by the prior sigmas, so the prior adds the identity.
            Matrix normal = Matrix::Identity();
            Vector right = (mean_ - value).cwiseQuotient(sigma_);
            add_observations(value, normal, right);
            const Eigen::LLT<Matrix> factor(normal);
            if (factor.info() != Eigen::Success) return Vector::Constant(std::numeric_limits<double>::quiet_NaN());
            value += sigma_.cwiseProduct(factor.solve(right));
        }
        return value;
    }

   private:
    void add_observations(const Vector& value, Matrix& normal, Vector& right) {
        const Vector3d u_gps = value.head<3>(), u_sen = value.segment<3>(9);
        const Rotation pos[2] = {Rotation(value.segment<3>(3)), Rotation(value.segment<3>(6))}, sen(value.tail<3>());
        int used[2] = {0, 0};
        for (const Seen& s : seen_) {
            const Rotation& turned = pos[s.swing];
            const Matrix3d outer = turned.matrix * s.turn;
            const Vector3d from_gps = s.point - u_gps;
            const Vector3d from_sen = outer.transpose() * from_gps - u_sen;
            const Vector3d q = sen.matrix.transpose() * from_sen;

            // d(sample, offset) / dq
            const double inverse_depth = -1 / q.z(), per = focal_px_ * inverse_depth;
            const Vector2d image(per * q.x(), s.sign * per * q.y());
            const Vector3d dq[2] = {{per, 0, image.x() * inverse_depth}, {0, s.sign * per, image.y() * inverse_depth}};
            for (int axis = 0; axis < 2; ++axis) {
                // The row carried outwards, frame by frame: what a shift of that frame's point does to the pixel. A turn by d
                // about axis w moves R^T p by R^T (p x w) d, hence the row times it is (row x p) . w d.
                const Vector3d at_sen = sen.matrix * (s.weight[axis] * dq[axis]), at_gps = outer * at_sen;
                rows_[s.swing].col(used[s.swing]++) << -at_gps, turned.axes * at_gps.cross(from_gps), -at_sen,
                    sen.axes * at_sen.cross(from_sen), s.weight[axis] * (s.pixel[axis] - image[axis]);
            }
        }
        for (int swing = 0; swing < 2; ++swing) {
            const auto rows = rows_[swing].leftCols(used[swing]);
            const Eigen::Matrix<double, ACTING + 1, ACTING + 1> sums = rows * rows.transpose();
            for (int a = 0; a < ACTING; ++a) {
                const int i = ACTS[swing][a];
                right[i] += sigma_[i] * sums(a, ACTING);
                for (int b = 0; b <= a; ++b) normal(i, ACTS[swing][b]) += sigma_[i] * sigma_[ACTS[swing][b]] * sums(a, b);
            }
        }
    }
};

}  // namespace

// prior_mean, prior_sigma: (15,) metres and radians, for all lanes; the start is the prior mean. value: (lanes, 15).
extern "C" void gauss_newton(const Observations* observed, const double* prior_mean, const double* prior_sigma, int steps,
                             double* value) {
    Calibration calibration(*observed, prior_mean, prior_sigma);
    for (std::int64_t lane = 0; lane < observed->lanes; ++lane) {
        Eigen::Map<Vector>(value + UNKNOWNS * lane) = calibration.solve(*observed, lane, steps);
    }
}
