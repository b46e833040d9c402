#ifndef RCLCPP__RCLCPP_HPP_
#define RCLCPP__RCLCPP_HPP_

#include <cstdint>
#include <cstdio>
#include <map>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace rclcpp
{
class Time
{
public:
  explicit Time(std::int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }

private:
  std::int64_t nanoseconds_;
};

class Duration
{
public:
  Duration(std::int32_t seconds, std::uint32_t nanoseconds) : nanoseconds_(seconds * INT64_C(1000000000) + nanoseconds) {}
  double seconds() const { return 1e-9 * static_cast<double>(nanoseconds_); }

private:
  std::int64_t nanoseconds_;
};

class Logger
{
};

using ParameterValue = std::variant<std::int64_t, std::vector<double>, std::vector<std::string>>;

class Parameter
{
public:
  explicit Parameter(ParameterValue value) : value_(std::move(value)) {}
  std::int64_t as_int() const { return std::get<std::int64_t>(value_); }
  std::vector<double> as_double_array() const { return std::get<std::vector<double>>(value_); }
  std::vector<std::string> as_string_array() const { return std::get<std::vector<std::string>>(value_); }

private:
  ParameterValue value_;
};
}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) \
  do { \
    static_cast<void>(logger); \
    std::fprintf(stderr, __VA_ARGS__); \
    std::fputc('\n', stderr); \
  } while (0)

#endif
