// Gauss-Newton with priors and a covariance on Pinocchio: what a fit costs in C++, for `engine.py --cpp`.
//
// Reads a problem that `engine.py` wrote, fits it as often as it is told to, and prints the median CPU seconds of a fit, then the estimate.
// Constants of the way are products of exponentials as in `urdfcal/model/walk.py`; frames are Pinocchio's, one forwardKinematics a pose.

#include <algorithm>
#include <ctime>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/spatial.hpp>

using Eigen::MatrixXd;
using Eigen::VectorXd;
using pinocchio::Motion;
using pinocchio::SE3;

struct Factor {
  int column;
  Motion screw;
};

struct Stretch {
  int anchor;
  SE3 end;
  std::vector<Factor> factors;
};

struct Target {
  int stretch, depth;  // of the frame that is read
  std::vector<double> values;
};

static SE3 placement(std::istream& in) {
  SE3::Matrix3 R;
  SE3::Vector3 p;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) in >> R(i, j);
    in >> p(i);
  }
  return SE3(R, p);
}

struct Problem {
  pinocchio::Model model;
  std::vector<Stretch> stretches;
  std::vector<std::vector<int>> moves;  // by frame: 1 where a parameter moves it
  std::vector<Target> targets;
  int moving, frame, parameters, poses;  // frame: what targets are seen from; -1 for the base
  bool spots;
  MatrixXd q;
  VectorXd mean, sigma, start;

  explicit Problem(const std::string& path) {
    std::ifstream in(path);
    int joints, lines, count, numbers;
    in >> spots >> moving >> frame >> parameters >> poses;
    for (joints = 0; joints < moving; ++joints) {
      int slides;
      SE3::Vector3 axis;
      in >> slides >> axis(0) >> axis(1) >> axis(2);
      if (slides)
        model.addJoint(joints, pinocchio::JointModelPrismaticUnaligned(axis), SE3::Identity(), std::to_string(joints));
      else if (axis == SE3::Vector3::UnitZ())
        model.addJoint(joints, pinocchio::JointModelRZ(), SE3::Identity(), std::to_string(joints));
      else
        model.addJoint(joints, pinocchio::JointModelRevoluteUnaligned(axis), SE3::Identity(), std::to_string(joints));
    }
    in >> lines;
    for (int line = 0; line < lines; ++line) {
      Stretch own;
      in >> own.anchor >> count;
      own.end = placement(in);
      for (int k = 0; k < count; ++k) {
        Factor factor;
        in >> factor.column;
        Eigen::Matrix<double, 6, 1> screw;
        for (int i = 0; i < 6; ++i) in >> screw(i);
        factor.screw = Motion(screw);
        own.factors.push_back(factor);
      }
      stretches.push_back(own);
    }
    in >> lines;
    for (int line = 0; line < lines; ++line) {
      std::vector<int> row(parameters);
      for (int& one : row) in >> one;
      moves.push_back(row);
    }
    in >> lines;
    numbers = spots ? 2 : 3;
    for (int line = 0; line < lines; ++line) {
      Target own;
      in >> own.stretch >> own.depth;
      own.values.resize(numbers * poses);
      for (double& value : own.values) in >> value;
      targets.push_back(own);
    }
    q.resize(moving, poses);
    for (int pose = 0; pose < poses; ++pose)
      for (int joint = 0; joint < moving; ++joint) in >> q(joint, pose);
    mean.resize(parameters), sigma.resize(parameters), start.resize(parameters);
    for (VectorXd* own : {&mean, &sigma, &start})
      for (int k = 0; k < parameters; ++k) in >> (*own)(k);
    if (!in) throw std::runtime_error("the problem ends before its end");
  }

  // Normal equations of one sweep: A = J'J, b = J'r, and r'r.
  double sweep(pinocchio::Data& data, const VectorXd& x, MatrixXd& A, VectorXd& b) {
    std::vector<Motion> screws(parameters, Motion::Zero());
    std::vector<int> anchors(parameters, 0);
    std::vector<SE3> frames;
    for (std::size_t row = 0; row < stretches.size(); ++row) {
      SE3 reached = SE3::Identity();
      for (const Factor& factor : stretches[row].factors) {
        screws[factor.column] = reached.act(factor.screw);
        anchors[factor.column] = stretches[row].anchor;
        reached = reached * pinocchio::exp6(Motion(factor.screw * x(factor.column)));
      }
      reached = reached * stretches[row].end;
      if (int(row) < moving)
        model.jointPlacements[row + 1] = reached;
      else
        frames.push_back(reached);
    }
    A.setZero(), b.setZero();
    double squares = 0;
    const int numbers = spots ? 2 : 3;
    MatrixXd J(numbers * targets.size(), parameters);
    VectorXd r(numbers * targets.size());
    for (int pose = 0; pose < poses; ++pose) {
      pinocchio::forwardKinematics(model, data, q.col(pose));
      const SE3 from = frame < 0 ? SE3::Identity() : frames[frame];  // it stands in the base
      int line = 0;
      for (const Target& target : targets) {
        const SE3 here = from.actInv(data.oMi[target.depth] * frames[target.stretch]);
        Eigen::Matrix<double, 3, 6> jac2;
        if (spots) {
          const SE3::Vector3 p = here.translation(), z = here.rotation().col(2);
          const double k = -p(0) / z(0);
          const SE3::Vector3 spot = p + k * z;
          Eigen::Matrix<double, 3, 6> twist;
          twist.leftCols<3>().setIdentity();
          twist.rightCols<3>() = -pinocchio::skew(spot);
          jac2 = twist - z / z(0) * twist.row(0);
          for (int i = 0; i < 2; ++i) r(line + i) = target.values[numbers * pose + i] - spot(i + 1);
        } else {
          jac2.leftCols<3>().setIdentity();
          jac2.rightCols<3>() = -pinocchio::skew(here.translation());
          for (int i = 0; i < 3; ++i) r(line + i) = target.values[numbers * pose + i] - here.translation()(i);
        }
        const int first = spots ? 1 : 0;
        for (int column = 0; column < parameters; ++column) {
          const int share = moves[target.stretch][column] - (frame < 0 ? 0 : moves[frame][column]);
          const Motion twist = from.actInv(data.oMi[anchors[column]].act(screws[column]));
          J.col(column).segment(line, numbers) = share * (jac2.middleRows(first, numbers) * twist.toVector());
        }
        line += numbers;
      }
      A.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
      b.noalias() += J.transpose() * r;
      squares += r.squaredNorm();
    }
    return squares;
  }

  // From the start to rest, the noise estimated from the residual; gives back the covariance.
  MatrixXd fit(VectorXd& x, double noise) {
    pinocchio::Data data(model);
    MatrixXd A(parameters, parameters), P;
    VectorXd b(parameters);
    const VectorXd weights = sigma.cwiseAbs2().cwiseInverse();
    bool settled = false;
    x = start;
    for (int sweeps = 0; sweeps < 100; ++sweeps) {
      const double squares = sweep(data, x, A, b);
      MatrixXd information = A.selfadjointView<Eigen::Lower>();
      information /= noise * noise;
      information.diagonal() += weights;
      P = information.llt().solve(MatrixXd::Identity(parameters, parameters));
      const VectorXd step = P * (b / (noise * noise) - weights.cwiseProduct(x - mean));
      const double largest = (step.array().abs() / P.diagonal().array().sqrt()).maxCoeff();
      x += step;
      if (settled && largest < 1e-7) break;
      if (largest < 1e-2 && !settled) {
        const double decided = parameters - P.diagonal().dot(weights);
        const int numbers = (spots ? 2 : 3) * int(targets.size()) * poses;
        noise = std::sqrt(squares / (numbers - decided));
        settled = true;
      }
    }
    return P;
  }
};

int main(int, char** words) {
  Problem problem(words[1]);
  VectorXd x;
  MatrixXd P;
  std::vector<double> seconds;
  for (int run = 0; run < std::atoi(words[2]); ++run) {
    const std::clock_t began = std::clock();
    P = problem.fit(x, 1e-3);
    seconds.push_back(double(std::clock() - began) / CLOCKS_PER_SEC);
  }
  std::sort(seconds.begin(), seconds.end());
  std::cout.precision(17);
  std::cout << seconds[seconds.size() / 2] << "\n" << x.transpose() << "\n" << P.diagonal().cwiseSqrt().transpose() << std::endl;
}
