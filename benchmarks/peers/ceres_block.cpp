// The block adjustment of a three-line camera by Ceres: sparse Schur complement, points eliminated first, derivatives by Jets.
//
// A ray measures point p where the camera imaged it. With the ray's own pose (R, t) world_from_body, turn and shift the weighted
// sums over the four nodes that act on it, A a signed permutation, B = Rx(ex) Ry(ey) Rz(ez) the boresight and l its lever arm,
//     q = B^T A^T exp(-[turn]x) (R^T (p - t) - shift) - l,    x = -f q_x / q_z,    y = -f q_y / q_z;
// the centred sample s solves s + along(s / half_width) = y, the line offset is x - offset - across(s / half_width).
//
// ceres_block FILE ITERATIONS FUNCTION_TOLERANCE GRADIENT_TOLERANCE PARAMETER_TOLERANCE DERIVATIVES [SOLUTION]
//
// DERIVATIVES is nodes: Jets carry the derivatives by all parameters of a ray, those of the four nodes included, as one would write
// it first; or motion: Jets carry those by the ray's own turn and shift, which are then weighted, as one would write it second.
//
// FILE is written, and SOLUTION (nodes, shared, points as doubles) read, by peers/ceres_block.py. Prints one line of JSON.
#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace {

constexpr int ACTING = 4, NODE = 6, MOUNT = 6, DEFORMATION = 8, POINT = 3;

// The arrays of peers/ceres_block.py: BlockArrays, in the order of the file.
struct Arrays {
    std::int64_t rays, points, nodes, views, rows, entries, controls;
    std::vector<double> camera;  // focal length, principal sample, half width, body_from_imu (9)
    std::vector<double> offset_px, quaternion, position_m, weight, pixel_px, sigma_px;
    std::vector<double> node, shared, point_m;  // start values, then the solution; shared: mount, deformation of each view
    std::vector<double> shared_mean, shared_sigma, prior_coefficient, control_m, control_whitening;
    std::vector<std::int32_t> first_node, view, point, shared_held, prior_start, prior_axis, prior_node, control;

    explicit Arrays(const char* path) {
        std::ifstream file(path, std::ios::binary);
        file.exceptions(std::ios::failbit | std::ios::badbit | std::ios::eofbit);
        const auto read = [&](auto& to, std::int64_t count) {
            to.resize(count);
            file.read(reinterpret_cast<char*>(to.data()), count * sizeof(to[0]));
        };
        std::vector<std::int64_t> counts;
        read(counts, 7);
        rays = counts[0], points = counts[1], nodes = counts[2], views = counts[3];
        rows = counts[4], entries = counts[5], controls = counts[6];
        const std::int64_t all_shared = MOUNT + DEFORMATION * views;
        read(camera, 12), read(offset_px, views), read(quaternion, 4 * rays), read(position_m, 3 * rays);
        read(weight, ACTING * rays), read(pixel_px, 2 * rays), read(sigma_px, 2 * rays);
        read(node, NODE * nodes), read(shared, all_shared), read(point_m, POINT * points);
        read(shared_mean, all_shared), read(shared_sigma, all_shared), read(prior_coefficient, entries);
        read(control_m, POINT * controls), read(control_whitening, POINT * POINT * controls);
        read(first_node, rays), read(view, rays), read(point, rays), read(shared_held, all_shared);
        read(prior_start, rows + 1), read(prior_axis, rows), read(prior_node, entries), read(control, controls);
    }

    // What the cost functions hold by now.
    void forget_rays() {
        for (auto* of_rays : {&quaternion, &position_m, &weight, &pixel_px, &sigma_px}) std::vector<double>().swap(*of_rays);
        for (auto* of_rays : {&first_node, &view, &point}) std::vector<std::int32_t>().swap(*of_rays);
    }

    double* mount() { return shared.data(); }
    double* deformation(int view) { return shared.data() + MOUNT + DEFORMATION * view; }
};

struct Camera {
    double focal_px, principal_px, half_width_px;
    std::array<int, 3> body_axis;  // along which each axis of the IMU lies, and its sign
    std::array<double, 3> sign;

    explicit Camera(const std::vector<double>& v) : focal_px(v[0]), principal_px(v[1]), half_width_px(v[2]) {
        for (int imu = 0; imu < 3; ++imu)
            for (int body = 0; body < 3; ++body)
                if (const double a = v[3 + 3 * body + imu]; a != 0) body_axis[imu] = body, sign[imu] = a;
    }
};

// The two components across an axis after a turn of the frame by `angle` about it.
template <typename T>
void turn_frame(const T& angle, T& u, T& v) {
    using std::cos, std::sin;
    const T c = cos(angle), s = sin(angle), turned = c * u + s * v;
    v = c * v - s * u;
    u = turned;
}

template <typename T>
T cubic(const T* c, const T& u) {
    return c[0] + u * (c[1] + u * (c[2] + u * c[3]));
}

class Ray {
public:
    // By nodes and by the ray's own motion.
    using ByNodes = ceres::AutoDiffCostFunction<Ray, 2, NODE, NODE, NODE, NODE, MOUNT, DEFORMATION, POINT>;
    class ByMotion;

    Ray(const Camera& camera, const Arrays& a, std::int64_t i)
        : camera_(camera),
          offset_px_(a.offset_px[a.view[i]]) {
        const double* q = &a.quaternion[4 * i];
        const double wxyz[4] = {q[3], q[0], q[1], q[2]};
        ceres::QuaternionToRotation(wxyz, rotation_);
        std::copy_n(&a.position_m[3 * i], 3, position_m_);
        std::copy_n(&a.weight[ACTING * i], ACTING, weight_);
        std::copy_n(&a.pixel_px[2 * i], 2, pixel_px_);
        for (int k = 0; k < 2; ++k) per_sigma_[k] = 1 / a.sigma_px[2 * i + k];
    }

    template <typename T>
    bool operator()(const T* n0, const T* n1, const T* n2, const T* n3, const T* mount, const T* deformation, const T* point,
                    T* residual) const {
        T motion[NODE];
        for (int k = 0; k < NODE; ++k) motion[k] = weight_[0] * n0[k] + weight_[1] * n1[k] + weight_[2] * n2[k] + weight_[3] * n3[k];
        return (*this)(motion, mount, deformation, point, residual);
    }

    template <typename T>
    bool operator()(const T* motion, const T* mount, const T* deformation, const T* point, T* residual) const {
        const T from[3] = {point[0] - position_m_[0], point[1] - position_m_[1], point[2] - position_m_[2]};
        T back[3], p[3], moved[3];
        for (int k = 0; k < 3; ++k) {
            back[k] = -motion[k];
            p[k] = rotation_[k] * from[0] + rotation_[3 + k] * from[1] + rotation_[6 + k] * from[2] - motion[3 + k];
        }
        ceres::AngleAxisRotatePoint(back, p, moved);
        T q[3];
        for (int k = 0; k < 3; ++k) q[k] = camera_.sign[k] * moved[camera_.body_axis[k]];
        turn_frame(mount[0], q[1], q[2]);
        turn_frame(mount[1], q[2], q[0]);
        turn_frame(mount[2], q[0], q[1]);
        for (int k = 0; k < 3; ++k) q[k] -= mount[3 + k];
        if (!(q[2] < 0.0)) return false;  // behind the camera: the step is refused

        const T scale = -camera_.focal_px / q[2], along = scale * q[1];
        const double per_width = 1 / camera_.half_width_px;
        T s = along;
        for (int pass = 0; pass < 4; ++pass) s = along - cubic(deformation, T(s * per_width));
        const T across = scale * q[0] - cubic(deformation + 4, T(s * per_width));
        residual[0] = (pixel_px_[0] - camera_.principal_px - s) * per_sigma_[0];
        residual[1] = (pixel_px_[1] + offset_px_ - across) * per_sigma_[1];
        return true;
    }

private:
    const Camera& camera_;
    double offset_px_, rotation_[9], position_m_[3], weight_[ACTING], pixel_px_[2], per_sigma_[2];
};

class Ray::ByMotion : public ceres::SizedCostFunction<2, NODE, NODE, NODE, NODE, MOUNT, DEFORMATION, POINT> {
public:
    ByMotion(const Camera& camera, const Arrays& a, std::int64_t i) : ray_(camera, a, i) {}

    bool Evaluate(double const* const* parameter, double* residual, double** jacobian) const override {
        double motion[NODE] = {}, by_motion[2 * NODE];
        for (int m = 0; m < ACTING; ++m)
            for (int k = 0; k < NODE; ++k) motion[k] += ray_.weight_[m] * parameter[m][k];
        const double *const *rest = parameter + ACTING, *const inner[4] = {motion, rest[0], rest[1], rest[2]};
        if (!jacobian) return ray_(inner[0], inner[1], inner[2], inner[3], residual);
        double* by_inner[4] = {by_motion, jacobian[ACTING], jacobian[ACTING + 1], jacobian[ACTING + 2]};
        using Sizes = ceres::internal::StaticParameterDims<NODE, MOUNT, DEFORMATION, POINT>;
        if (!ceres::internal::AutoDifferentiate<2, Sizes>(ray_, inner, 2, residual, by_inner)) return false;
        for (int m = 0; m < ACTING; ++m)
            if (jacobian[m])
                for (int k = 0; k < 2 * NODE; ++k) jacobian[m][k] = ray_.weight_[m] * by_motion[k];
        return true;
    }

private:
    Ray ray_;
};

// The sum of coefficient * (one axis of a node) over several nodes.
class NodePrior : public ceres::CostFunction {
public:
    NodePrior(int axis, std::vector<double> coefficient) : axis_(axis), coefficient_(std::move(coefficient)) {
        set_num_residuals(1);
        mutable_parameter_block_sizes()->assign(coefficient_.size(), NODE);
    }
    bool Evaluate(double const* const* node, double* residual, double** jacobian) const override {
        residual[0] = 0;
        for (std::size_t i = 0; i < coefficient_.size(); ++i) {
            residual[0] += coefficient_[i] * node[i][axis_];
            if (!jacobian || !jacobian[i]) continue;
            std::fill_n(jacobian[i], NODE, 0.0);
            jacobian[i][axis_] = coefficient_[i];
        }
        return true;
    }

private:
    int axis_;
    std::vector<double> coefficient_;
};

// whitening (value - mean) of one block; not ceres::NormalPrior, which takes matrices of an Eigen that was compiled otherwise.
class BlockPrior : public ceres::CostFunction {
public:
    BlockPrior(int size, std::vector<double> whitening, const double* mean)
        : whitening_(std::move(whitening)),
          mean_(mean, mean + size) {
        set_num_residuals(static_cast<int>(whitening_.size()) / size);
        mutable_parameter_block_sizes()->push_back(size);
    }
    bool Evaluate(double const* const* value, double* residual, double** jacobian) const override {
        const int size = static_cast<int>(mean_.size());
        for (int row = 0; row < num_residuals(); ++row) {
            residual[row] = 0;
            for (int k = 0; k < size; ++k) residual[row] += whitening_[size * row + k] * (value[0][k] - mean_[k]);
        }
        if (jacobian && jacobian[0]) std::copy(whitening_.begin(), whitening_.end(), jacobian[0]);
        return true;
    }

private:
    std::vector<double> whitening_, mean_;
};

// The mount, or the deformation of a view, with its prior; a sigma of 0 is none.
void add_shared(ceres::Problem& problem, Arrays& a, double* block, int size) {
    const std::ptrdiff_t first = block - a.shared.data();
    std::vector<double> whitening;
    std::vector<int> held;
    for (int k = 0; k < size; ++k) {
        if (a.shared_held[first + k]) held.push_back(k);
        if (a.shared_sigma[first + k] == 0) continue;
        whitening.resize(whitening.size() + size);
        whitening[whitening.size() - size + k] = 1 / a.shared_sigma[first + k];
    }
    problem.AddParameterBlock(block, size);
    if (static_cast<int>(held.size()) == size)
        problem.SetParameterBlockConstant(block);
    else if (!held.empty())
        problem.SetManifold(block, new ceres::SubsetManifold(size, held));
    if (!whitening.empty()) problem.AddResidualBlock(new BlockPrior(size, whitening, &a.shared_mean[first]), nullptr, block);
}

void build(ceres::Problem& problem, Arrays& a, const Camera& camera, bool by_motion) {
    add_shared(problem, a, a.mount(), MOUNT);
    for (int v = 0; v < a.views; ++v) add_shared(problem, a, a.deformation(v), DEFORMATION);
    for (std::int64_t i = 0; i < a.rays; ++i) {
        double* node = &a.node[NODE * a.first_node[i]];
        ceres::CostFunction* cost = by_motion ? static_cast<ceres::CostFunction*>(new Ray::ByMotion(camera, a, i))
                                              : new Ray::ByNodes(new Ray(camera, a, i));
        problem.AddResidualBlock(
            cost, nullptr, node, node + NODE, node + 2 * NODE, node + 3 * NODE, a.mount(), a.deformation(a.view[i]),
            &a.point_m[POINT * a.point[i]]);
    }
    for (std::int64_t row = 0; row < a.rows; ++row) {
        const std::int32_t begin = a.prior_start[row], end = a.prior_start[row + 1];
        std::vector<double*> nodes;
        for (std::int32_t e = begin; e < end; ++e) nodes.push_back(&a.node[NODE * a.prior_node[e]]);
        const double* c = a.prior_coefficient.data();
        problem.AddResidualBlock(new NodePrior(a.prior_axis[row], {c + begin, c + end}), nullptr, nodes);
    }
    for (std::int64_t i = 0; i < a.controls; ++i) {
        // Two residuals at a time as of a ray, one of them empty: for points with three, Ceres would leave its loops for 2 x 3.
        const double* w = &a.control_whitening[POINT * POINT * i];
        for (const auto& two : {std::vector<double>(w, w + 2 * POINT), std::vector<double>{w[6], w[7], w[8], 0, 0, 0}})
            problem.AddResidualBlock(
                new BlockPrior(POINT, two, &a.control_m[POINT * i]), nullptr, &a.point_m[POINT * a.control[i]]);
    }
}

// Peak of the resident memory in bytes. Not getrusage: what it tells includes the process that started this one.
double peak_bytes() {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
        if (word == "VmHWM:") {
            double kib;
            status >> kib;
            return 1024 * kib;
        }
    return NAN;
}

double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

// CPU time of the fastest iteration that gained something: one that does not makes no derivatives.
struct Stopwatch : ceres::IterationCallback {
    double last_s = 0, fastest_s = INFINITY;

    ceres::CallbackReturnType operator()(const ceres::IterationSummary& told) override {
        const double now_s = cpu_seconds();
        if (told.iteration > 0 && told.step_is_successful) fastest_s = std::min(fastest_s, now_s - last_s);
        last_s = now_s;
        return ceres::SOLVER_CONTINUE;
    }
};

}  // namespace

int main(int count, char** argument) {
    if (count < 7) return std::fputs("usage: see the head of ceres_block.cpp\n", stderr), 2;
    Arrays a(argument[1]);
    const Camera camera(a.camera);
    ceres::Problem::Options lean;
    lean.disable_all_safety_checks = true;
    ceres::Problem problem(lean);
    build(problem, a, camera, std::string(argument[6]) == "motion");
    a.forget_rays();

    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.sparse_linear_algebra_library_type =
        ceres::IsSparseLinearAlgebraLibraryTypeAvailable(ceres::SUITE_SPARSE) ? ceres::SUITE_SPARSE : ceres::EIGEN_SPARSE;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    std::vector<double*> blocks;
    problem.GetParameterBlocks(&blocks);
    const double *first = a.point_m.data(), *last = first + a.point_m.size();
    for (double* block : blocks)
        options.linear_solver_ordering->AddElementToGroup(block, first <= block && block < last ? 0 : 1);
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = std::atoi(argument[2]);
    options.function_tolerance = std::atof(argument[3]);
    options.gradient_tolerance = std::atof(argument[4]);
    options.parameter_tolerance = std::atof(argument[5]);

    Stopwatch watch;
    options.callbacks.push_back(&watch);

    ceres::Solver::Summary told;
    const double start_s = cpu_seconds();
    ceres::Solve(options, &problem, &told);
    const double cpu_s = cpu_seconds() - start_s;
    if (!told.IsSolutionUsable()) return std::fprintf(stderr, "%s\n", told.message.c_str()), 1;
    if (count > 7) {
        std::ofstream file(argument[7], std::ios::binary);
        for (const auto* values : {&a.node, &a.shared, &a.point_m})
            file.write(reinterpret_cast<const char*>(values->data()), values->size() * sizeof(double));
    }
    const std::size_t iterations = told.iterations.size() - 1;  // the first is the start
    std::printf(
        "{\"initial_cost\": %.17g, \"final_cost\": %.17g, \"iterations\": %zu, \"converged\": %s, \"cpu_s\": %.6g, "
        "\"step_s\": %.6g, "
        "\"preprocessor_share\": %.4f, \"jacobian_share\": %.4f, \"linear_solver_share\": %.4f, \"residual_share\": %.4f, "
        "\"peak_gb\": %.4f, \"library\": \"Ceres %s, %s, %s, structure %s\"}\n",
        told.initial_cost, told.final_cost, iterations, told.termination_type == ceres::CONVERGENCE ? "true" : "false", cpu_s,
        std::isfinite(watch.fastest_s) ? watch.fastest_s : 0.0,
        told.preprocessor_time_in_seconds / told.total_time_in_seconds,
        told.jacobian_evaluation_time_in_seconds / told.total_time_in_seconds,
        told.linear_solver_time_in_seconds / told.total_time_in_seconds,
        told.residual_evaluation_time_in_seconds / told.total_time_in_seconds, peak_bytes() / 1e9, CERES_VERSION_STRING,
        ceres::LinearSolverTypeToString(told.linear_solver_type_used),
        ceres::SparseLinearAlgebraLibraryTypeToString(told.sparse_linear_algebra_library_type),
        told.schur_structure_used.c_str());
}
