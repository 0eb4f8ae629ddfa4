// The same problem solved with Ceres: `solve FILE plain|careful LINEAR_SOLVER POSES` prints what it took as JSON and writes the poses found.
//
// "plain" is how Ceres is mostly used: automatic derivatives, one residual block for each corner. "careful" has analytic derivatives, one residual
// block for each picture of a target, and tangent-space Jacobians handed through without a product. FILE is what `examples/solver_problem.rs` writes.

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <sys/resource.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

struct Pose {
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
    Vector3 t = Vector3::Zero();
    Pose operator*(const Pose& o) const { return {q * o.q, q * o.t + t}; }
    Pose inverse() const { return {q.conjugate(), -(q.conjugate() * t)}; }
};

static Pose pose_of(const double* x) { return {Eigen::Quaterniond(x[3], x[0], x[1], x[2]), Vector3(x[4], x[5], x[6])}; }

struct Corner { double point[3], pixel[2], weight; };

struct Block {
    int camera;
    std::vector<std::array<double, 7>> known;  // one more than unknown
    std::vector<int> unknown;
    std::vector<bool> inverse;
    std::vector<Corner> corners;
};

struct Problem {
    std::vector<std::array<double, 7>> poses;
    std::vector<std::array<double, 9>> lenses;
    std::vector<Block> blocks;
    bool free_lens;
};

static Problem read(const std::string& file) {
    std::ifstream in(file, std::ios::binary);
    auto take = [&](double* to, size_t n) {
        in.read(reinterpret_cast<char*>(to), n * sizeof(double));
        if (!in) { std::fprintf(stderr, "the file ends early\n"); std::exit(1); }
    };
    double header[4];
    take(header, 4);
    Problem p;
    p.poses.resize(header[0]);
    p.lenses.resize(header[1]);
    p.blocks.resize(header[2]);
    p.free_lens = header[3] != 0;
    for (auto& x : p.poses) take(x.data(), 7);
    for (auto& x : p.lenses) take(x.data(), 9);
    for (auto& b : p.blocks) {
        double head[3];
        take(head, 3);
        b.camera = head[0];
        b.known.resize(size_t(head[1]) + 1);
        b.corners.resize(head[2]);
        take(b.known[0].data(), 7);
        for (size_t i = 1; i < b.known.size(); ++i) {
            double which[2];
            take(which, 2);
            b.unknown.push_back(which[0]);
            b.inverse.push_back(which[1] != 0);
            take(b.known[i].data(), 7);
        }
        take(reinterpret_cast<double*>(b.corners.data()), 6 * b.corners.size());
    }
    return p;
}

// What the system says of this process' memory, MB. Not getrusage: its peak is no less than what the process that started this one held then.
static double megabytes(const std::string& what) {
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
        if (line.rfind(what, 0) == 0) return std::atof(line.c_str() + what.size()) / 1024;
    }
    return 0;
}

// One corner, for automatic derivatives.
struct PlainCorner {
    const Block& block;
    const Corner& corner;

    template <typename T>
    void through(const T* pose, bool inverse, T p[3]) const {
        Eigen::Map<const Eigen::Quaternion<T>> q(pose);
        Eigen::Map<const Eigen::Matrix<T, 3, 1>> t(pose + 4);
        Eigen::Map<Eigen::Matrix<T, 3, 1>> x(p);
        if (inverse) x = (q.conjugate() * (x - t)).eval();
        else x = (q * x + t).eval();
    }

    template <typename T>
    bool evaluate(const T* const* poses, const T* lens, T* residual) const {
        T p[3] = {T(corner.point[0]), T(corner.point[1]), T(corner.point[2])};
        for (size_t i = block.known.size(); i-- > 0;) {
            T known[7];
            for (int k = 0; k < 7; ++k) known[k] = T(block.known[i][k]);
            through(known, false, p);
            if (i > 0) through(poses[i - 1], block.inverse[i - 1], p);
        }
        const T x = p[0] / p[2], y = p[1] / p[2], r2 = x * x + y * y;
        const T g = T(1) + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]));
        const T xd = x * g + T(2) * lens[6] * x * y + lens[7] * (r2 + T(2) * x * x);
        const T yd = y * g + lens[6] * (r2 + T(2) * y * y) + T(2) * lens[7] * x * y;
        residual[0] = T(corner.weight) * (lens[0] * xd + lens[2] - T(corner.pixel[0]));
        residual[1] = T(corner.weight) * (lens[1] * yd + lens[3] - T(corner.pixel[1]));
        return true;
    }

    template <typename T> bool operator()(const T* a, const T* lens, T* r) const {
        const T* poses[] = {a};
        return evaluate(poses, lens, r);
    }
    template <typename T> bool operator()(const T* a, const T* b, const T* lens, T* r) const {
        const T* poses[] = {a, b};
        return evaluate(poses, lens, r);
    }
    template <typename T> bool operator()(const T* a, const T* b, const T* c, const T* lens, T* r) const {
        const T* poses[] = {a, b, c};
        return evaluate(poses, lens, r);
    }
};

// A pose perturbed on the right by (translation, rotation vector) in its own axes.
struct RightTwist : ceres::Manifold {
    int AmbientSize() const override { return 7; }
    int TangentSize() const override { return 6; }
    bool Plus(const double* x, const double* d, double* out) const override {
        const Pose p = pose_of(x);
        const Vector3 turn(d[3], d[4], d[5]);
        const double angle = turn.norm();
        Eigen::Quaterniond step = Eigen::Quaterniond::Identity();
        if (angle > 0) step = Eigen::AngleAxisd(angle, turn / angle);
        const Pose next{(p.q * step).normalized(), p.q * Vector3(d[0], d[1], d[2]) + p.t};
        Eigen::Map<Eigen::Vector4d>{out} = next.q.coeffs();
        Eigen::Map<Vector3>{out + 4} = next.t;
        return true;
    }
    // The cost functions give derivatives to the tangent in the first six places.
    bool PlusJacobian(const double*, double* j) const override { return selector<7, 6>(j); }
    bool Minus(const double* y, const double* x, double* d) const override {
        const Pose a = pose_of(x), b = pose_of(y);
        const Eigen::AngleAxisd turn(a.q.conjugate() * b.q);
        Eigen::Map<Vector3>{d} = a.q.conjugate() * (b.t - a.t);
        Eigen::Map<Vector3>{d + 3} = turn.angle() * turn.axis();
        return true;
    }
    bool MinusJacobian(const double*, double* j) const override { return selector<6, 7>(j); }
    template <int Rows, int Columns> static bool selector(double* j) {
        Eigen::Map<Eigen::Matrix<double, Rows, Columns, Eigen::RowMajor>>{j}.setIdentity();
        return true;
    }
};

static Matrix3 skew(const Vector3& v) {
    Matrix3 m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

// All corners of one picture of a target.
struct CarefulPicture : ceres::CostFunction {
    const Block& block;
    explicit CarefulPicture(const Block& b) : block(b) {
        for (size_t i = 0; i < b.unknown.size(); ++i) mutable_parameter_block_sizes()->push_back(7);
        mutable_parameter_block_sizes()->push_back(9);
        set_num_residuals(2 * int(b.corners.size()));
    }
    bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
        const size_t k = block.unknown.size();
        Pose after = pose_of(block.known[k].data());
        std::array<Matrix6, 3> chain;
        for (size_t i = k; i-- > 0;) {
            Pose value = pose_of(x[i]);
            if (block.inverse[i]) value = value.inverse();
            const Pose with = value * after;
            if (jacobians && jacobians[i]) {
                const Pose& at = block.inverse[i] ? with : after;
                const Matrix3 r = at.q.toRotationMatrix().transpose();
                const double sign = block.inverse[i] ? -1 : 1;
                chain[i].setZero();
                chain[i].topLeftCorner<3, 3>() = sign * r;
                chain[i].bottomRightCorner<3, 3>() = sign * r;
                chain[i].topRightCorner<3, 3>() = -sign * r * skew(at.t);
            }
            after = pose_of(block.known[i].data()) * with;
        }
        const Matrix3 r = after.q.toRotationMatrix();
        const double* l = x[k];
        for (size_t c = 0; c < block.corners.size(); ++c) {
            const Corner& corner = block.corners[c];
            const Vector3 place(corner.point[0], corner.point[1], corner.point[2]);
            const Vector3 p = r * place + after.t;
            const double w = 1 / p.z(), X = p.x() * w, Y = p.y() * w, r2 = X * X + Y * Y, s = corner.weight;
            const double g = 1 + r2 * (l[4] + r2 * (l[5] + r2 * l[8]));
            const double xd = X * g + 2 * l[6] * X * Y + l[7] * (r2 + 2 * X * X);
            const double yd = Y * g + l[6] * (r2 + 2 * Y * Y) + 2 * l[7] * X * Y;
            residuals[2 * c] = s * (l[0] * xd + l[2] - corner.pixel[0]);
            residuals[2 * c + 1] = s * (l[1] * yd + l[3] - corner.pixel[1]);
            if (!jacobians) continue;
            const double slope = 2 * (l[4] + r2 * (2 * l[5] + r2 * 3 * l[8]));
            const double xx = g + X * X * slope + 2 * l[6] * Y + 6 * l[7] * X;
            const double xy = X * Y * slope + 2 * l[6] * X + 2 * l[7] * Y;
            const double yy = g + Y * Y * slope + 6 * l[6] * Y + 2 * l[7] * X;
            Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
            by_point << l[0] * xx, l[0] * xy, -l[0] * (xx * X + xy * Y), l[1] * xy, l[1] * yy, -l[1] * (xy * X + yy * Y);
            const Eigen::Matrix<double, 2, 3> turned = s * w * by_point * r;
            Eigen::Matrix<double, 2, 6> twist;
            twist.leftCols<3>() = turned;
            twist.row(0).tail<3>() = place.cross(turned.row(0).transpose()).transpose();
            twist.row(1).tail<3>() = place.cross(turned.row(1).transpose()).transpose();
            for (size_t i = 0; i < k; ++i) {
                if (!jacobians[i]) continue;
                Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> j(jacobians[i] + 14 * c);
                j.leftCols<6>().noalias() = twist * chain[i];
                j.col(6).setZero();
            }
            if (jacobians[k]) {
                Eigen::Map<Eigen::Matrix<double, 2, 9, Eigen::RowMajor>> j(jacobians[k] + 18 * c);
                const double fx = s * l[0], fy = s * l[1], q = r2 * r2;
                j << s * xd, 0, s, 0, fx * X * r2, fx * X * q, fx * 2 * X * Y, fx * (r2 + 2 * X * X), fx * X * q * r2,
                    0, s * yd, 0, s, fy * Y * r2, fy * Y * q, fy * (r2 + 2 * Y * Y), fy * 2 * X * Y, fy * Y * q * r2;
            }
        }
        return true;
    }
};

int main(int count, char** arguments) {
    if (count != 5 && count != 6) {
        std::fprintf(stderr, "solve FILE plain|careful LINEAR_SOLVER POSES [FUNCTION_TOLERANCE]\n");
        return 2;
    }
    Problem input = read(arguments[1]);
    const bool plain = std::string(arguments[2]) == "plain";
    const auto began = std::chrono::steady_clock::now();
    ceres::Problem::Options ownership;
    ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>> product;
    RightTwist twist;
    ceres::Problem problem(ownership);
    std::vector<bool> used(input.poses.size());
    for (const Block& block : input.blocks) {
        std::vector<double*> parameters;
        for (int i : block.unknown) {
            parameters.push_back(input.poses[i].data());
            used[i] = true;
        }
        parameters.push_back(input.lenses[block.camera].data());
        if (!plain) {
            problem.AddResidualBlock(new CarefulPicture(block), nullptr, parameters);
            continue;
        }
        for (const Corner& corner : block.corners) {
            auto* functor = new PlainCorner{block, corner};
            ceres::CostFunction* cost = nullptr;
            if (block.unknown.size() == 1) cost = new ceres::AutoDiffCostFunction<PlainCorner, 2, 7, 9>(functor);
            if (block.unknown.size() == 2) cost = new ceres::AutoDiffCostFunction<PlainCorner, 2, 7, 7, 9>(functor);
            if (block.unknown.size() == 3) cost = new ceres::AutoDiffCostFunction<PlainCorner, 2, 7, 7, 7, 9>(functor);
            problem.AddResidualBlock(cost, nullptr, parameters);
        }
    }
    for (size_t i = 0; i < used.size(); ++i) {
        if (used[i]) problem.SetManifold(input.poses[i].data(), plain ? static_cast<ceres::Manifold*>(&product) : &twist);
    }
    if (!input.free_lens) {
        for (auto& lens : input.lenses) {
            if (problem.HasParameterBlock(lens.data())) problem.SetParameterBlockConstant(lens.data());
        }
    }
    ceres::Solver::Options options;
    if (!ceres::StringToLinearSolverType(arguments[3], &options.linear_solver_type)) return 2;
    options.num_threads = 2;
    options.max_num_iterations = 100;
    // At 1e-12 Ceres stops 1e-9 m from the minimum; this is one step more.
    options.function_tolerance = count == 6 ? std::atof(arguments[5]) : 1e-14;
    options.parameter_tolerance = 1e-13;
    options.gradient_tolerance = 1e-16;
    ceres::Solver::Summary summary;
    auto processor = [] {
        rusage usage;
        getrusage(RUSAGE_SELF, &usage);
        return usage.ru_utime.tv_sec + usage.ru_stime.tv_sec + 1e-6 * (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    };
    const double spent = processor();
    const auto built = std::chrono::steady_clock::now();
    ceres::Solve(options, &problem, &summary);
    const auto ended = std::chrono::steady_clock::now();
    auto seconds = [](auto from, auto to) { return std::chrono::duration<double>(to - from).count(); };
    const double peak = megabytes("VmHWM:"), mapped = megabytes("RssFile:");
    std::printf("{\"who\": \"ceres %s\", \"linear_solver\": \"%s\", \"seconds\": %.6f, \"processor_seconds\": %.6f, \"build_seconds\": %.6f, \"iterations\": %d, "
                "\"cost\": %.17g, \"peak_mb\": %.3f, \"own_mb\": %.3f, \"words\": \"%s\"}\n",
                arguments[2], arguments[3], seconds(built, ended), processor() - spent, seconds(began, built), int(summary.iterations.size()),
                summary.final_cost, peak, peak - mapped, ceres::TerminationTypeToString(summary.termination_type));
    std::ofstream out(arguments[4], std::ios::binary);
    for (const auto& pose : input.poses) out.write(reinterpret_cast<const char*>(pose.data()), 7 * sizeof(double));
    return summary.IsSolutionUsable() ? 0 : 1;
}
