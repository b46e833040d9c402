// The signatures of controller_interface_base.hpp and chainable_controller_interface.hpp.
#ifndef CONTROLLER_INTERFACE__CHAINABLE_CONTROLLER_INTERFACE_HPP_
#define CONTROLLER_INTERFACE__CHAINABLE_CONTROLLER_INTERFACE_HPP_

#include <memory>
#include <string>
#include <vector>

#include "hardware_interface/loaned_interfaces.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

namespace controller_interface
{
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;

enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };

enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names = {};
};

class ControllerInterfaceBase : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface
{
public:
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

  virtual void assign_interfaces(
    std::vector<hardware_interface::LoanedCommandInterface> && command_interfaces,
    std::vector<hardware_interface::LoanedStateInterface> && state_interfaces)
  {
    command_interfaces_ = std::move(command_interfaces);
    state_interfaces_ = std::move(state_interfaces);
  }

  // In ROS, init() makes the node.
  CallbackReturn init(std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node, unsigned int update_rate)
  {
    node_ = std::move(node);
    update_rate_ = update_rate;
    return on_init();
  }

  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
  std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
  unsigned int get_update_rate() const { return update_rate_; }

  template <typename ParameterT>
  auto auto_declare(const std::string & name, const ParameterT & default_value)
  {
    return node_->declare_parameter<ParameterT>(name, default_value);
  }

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_;
  unsigned int update_rate_ = 0;
};

class ChainableControllerInterface : public ControllerInterfaceBase
{
public:
  return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) final
  {
    if (!in_chained_mode_ && update_reference_from_subscribers(time, period) != return_type::OK) {
      return return_type::ERROR;
    }
    return update_and_write_commands(time, period);
  }

  std::vector<hardware_interface::CommandInterface::SharedPtr> export_reference_interfaces()
  {
    std::vector<hardware_interface::CommandInterface::SharedPtr> shared;
    for (auto & each : on_export_reference_interfaces()) {
      shared.push_back(std::make_shared<hardware_interface::CommandInterface>(std::move(each)));
    }
    return shared;
  }

  bool set_chained_mode(bool chained_mode)
  {
    in_chained_mode_ = chained_mode;
    return on_set_chained_mode(chained_mode);
  }

protected:
  virtual std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() = 0;
  virtual bool on_set_chained_mode(bool chained_mode) = 0;
  virtual return_type update_reference_from_subscribers(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual return_type update_and_write_commands(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

  std::vector<double> reference_interfaces_;

private:
  bool in_chained_mode_ = false;
};
}  // namespace controller_interface

#endif
