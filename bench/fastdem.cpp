// Times FastDEM on sweeps of points, for bench/mapping_peers.py.
//
//   fastdem sweep.f32...     N x 3 float32 each, in the sensor's frame
//
// To be built against FastDEM (https://github.com/Ikhyeon-Cho/FastDEM, MIT), with the flags of
// its own CMake (-O3 -DNDEBUG -std=gnu++17) and linked with its libraries. Its defaults are
// kept: Kalman filter, lidar noise, no ray casting, no limits of the points' filter. The map
// has 257 x 257 cells of 0.1 m. Prints one JSON object with times in milliseconds.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <functional>
#include <vector>

#include "fastdem/fastdem.hpp"
#include "fastdem/postprocess/feature_extraction.hpp"

static fastdem::PointCloud read(const char* path) {
  std::ifstream file(path, std::ios::binary);
  fastdem::PointCloud cloud;
  float p[3];
  while (file.read(reinterpret_cast<char*>(p), sizeof p)) cloud.add(p[0], p[1], p[2]);
  cloud.setFrameId("lidar");
  return cloud;
}

static double milliseconds(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

static double median(std::vector<double> times) {
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

struct Mapper {
  fastdem::ElevationMap map{25.7f, 25.7f, 0.1f, "map"};
  fastdem::FastDEM mapper{map};

  double sweep(const fastdem::PointCloud& cloud) {
    const auto still = Eigen::Isometry3d::Identity();
    return milliseconds([&] { mapper.integrate(cloud, still, still); });
  }
};

static double features(Mapper& mapper) {
  std::vector<double> times;
  for (int i = 0; i < 15; ++i)
    times.push_back(milliseconds([&] { fastdem::applyFeatureExtraction(mapper.map); }));
  return median(times);
}

int main(int count, char** paths) {
  std::vector<fastdem::PointCloud> sweeps;
  for (int i = 1; i < count; ++i) sweeps.push_back(read(paths[i]));
  if (sweeps.size() < 7 || sweeps[0].size() == 0) {
    std::fprintf(stderr, "needs at least seven files of points\n");
    return 2;
  }
  std::vector<double> first;
  for (int i = 0; i < 15; ++i) first.push_back(Mapper().sweep(sweeps[0]));
  Mapper once, further, again;
  once.sweep(sweeps[0]);
  std::vector<double> next, same;
  for (const auto& cloud : sweeps) next.push_back(further.sweep(cloud));
  for (std::size_t i = 0; i < sweeps.size(); ++i) same.push_back(again.sweep(sweeps[0]));
  std::printf("{\"points\": %zu, \"cells\": %d, \"first\": %.4f, \"second\": %.4f, \"sixth\": %.4f, "
              "\"same\": %.4f, \"features_first\": %.4f, \"features_further\": %.4f}\n",
              sweeps[0].size(), int(once.map.get("elevation").array().isFinite().count()), median(first),
              median({next.begin() + 1, next.begin() + 5}), median({next.begin() + 5, next.end()}),
              median({same.begin() + 1, same.end()}), features(once), features(further));
}
