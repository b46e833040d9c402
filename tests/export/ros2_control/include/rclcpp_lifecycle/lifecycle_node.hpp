#ifndef RCLCPP_LIFECYCLE__LIFECYCLE_NODE_HPP_
#define RCLCPP_LIFECYCLE__LIFECYCLE_NODE_HPP_

#include "rclcpp/rclcpp.hpp"

namespace rclcpp_lifecycle
{
class State
{
};

namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };

  virtual CallbackReturn on_configure(const State & previous_state) = 0;
  virtual CallbackReturn on_cleanup(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State &) { return CallbackReturn::SUCCESS; }
  virtual ~LifecycleNodeInterface() = default;
};
}  // namespace node_interfaces

class LifecycleNode
{
public:
  LifecycleNode(std::string name, std::map<std::string, rclcpp::ParameterValue> overrides)
  : name_(std::move(name)), overrides_(std::move(overrides))
  {
  }

  const char * get_name() const { return name_.c_str(); }
  rclcpp::Logger get_logger() const { return {}; }
  bool has_parameter(const std::string & name) const { return declared_.count(name) > 0; }
  rclcpp::Parameter get_parameter(const std::string & name) const { return rclcpp::Parameter(declared_.at(name)); }

  template <typename ParameterT>
  ParameterT declare_parameter(const std::string & name, const ParameterT & default_value)
  {
    const auto given = overrides_.find(name);
    if (given != overrides_.end() && !std::holds_alternative<ParameterT>(given->second)) {
      throw std::invalid_argument("parameter '" + name + "' has invalid type");
    }
    declared_.insert_or_assign(name, given == overrides_.end() ? rclcpp::ParameterValue(default_value) : given->second);
    return std::get<ParameterT>(declared_.at(name));
  }

private:
  std::string name_;
  std::map<std::string, rclcpp::ParameterValue> overrides_;
  std::map<std::string, rclcpp::ParameterValue> declared_;
};
}  // namespace rclcpp_lifecycle

#endif
