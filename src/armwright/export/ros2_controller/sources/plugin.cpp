// The controller '@law' of @arm as a chainable controller of ros2_control, for ROS 2 Jazzy and Kilted.
//
// Made by Armwright from a scenario: do not edit it, make it again. README.md has its interfaces and parameters.
// update() allocates nothing and takes no lock of its own while it returns OK; an error writes one line to the log.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <limits>
#include <string>
#include <vector>

#include "controller_interface/chainable_controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/rclcpp.hpp"

#include "@{name}.h"

namespace @name
{
namespace
{
using controller_interface::CallbackReturn;
using controller_interface::return_type;
using Names = std::vector<std::string>;

constexpr std::size_t JOINTS = @joints;
constexpr unsigned int RATE = @rate; // [Hz] of update(): one step of the controller each
constexpr std::size_t DELAY = @delay; // [steps] from a command to the drive, as in the simulation

const std::array<std::string, JOINTS> NAMES = {@names};
const std::array<std::string, JOINTS> COMMANDS = {@commands};
const std::array<std::string, @state_count> STATES = {@states};
const std::array<std::string, @reference_count> REFERENCES = {@references};

// A parameter: where it stands in the controller's struct, and which numbers it may have.
struct Field
{
  const char * name;
  std::size_t place;
  std::size_t count;
  bool infinite;
  bool negative;
};

const Field FIELDS[] = {
@fields
};

Names interface_names(const Names & joints, const std::string * kinds, std::size_t count)
{
  Names names;
  for (std::size_t i = 0; i < count; ++i) {
    for (const std::string & joint : joints) {
      names.push_back(joint + "/" + kinds[i]);
    }
  }
  return names;
}

template <typename Interfaces>
bool are(const Interfaces & interfaces, const Names & names)
{
  bool equal = interfaces.size() == names.size();
  for (std::size_t i = 0; equal && i < names.size(); ++i) {
    equal = interfaces[i].get_name() == names[i];
  }
  return equal;
}
}  // namespace

class Controller : public controller_interface::ChainableControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    try {
      auto_declare<Names>("joints", {});
      auto_declare<std::int64_t>("take_over_ticks", 0);
      for (const Field & field : FIELDS) {
        auto_declare<std::vector<double>>(field.name, {});
      }
    } catch (const std::exception & error) {
      RCLCPP_ERROR(get_node()->get_logger(), "parameters of another type than in config/controllers.yaml: %s", error.what());
      return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    const auto logger = get_node()->get_logger();
    if (get_update_rate() != RATE) {
      RCLCPP_ERROR(
        logger, "update_rate is %u Hz: expected %u Hz, for which this controller was designed", get_update_rate(), RATE);
      return CallbackReturn::ERROR;
    }
    return read_joints(logger) && read_fields(logger) ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
  }

  controller_interface::InterfaceConfiguration command_interface_configuration() const override
  {
    return {controller_interface::interface_configuration_type::INDIVIDUAL, command_names()};
  }

  controller_interface::InterfaceConfiguration state_interface_configuration() const override
  {
    return {controller_interface::interface_configuration_type::INDIVIDUAL, state_names()};
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    const auto logger = get_node()->get_logger();
    if (!are(command_interfaces_, command_names()) || !are(state_interfaces_, state_names())) {
      RCLCPP_ERROR(logger, "claimed interfaces are not those of the configuration: is a joint's name wrong?");
      return CallbackReturn::ERROR;
    }
    if (!measure()) {
      return CallbackReturn::ERROR;
    }
    for (std::size_t k = 0; k < JOINTS; ++k) {
      const double present = command_interfaces_[k].get_optional().value_or(NOTHING);
      command_.u[k] = std::isfinite(present) ? present : is_position(k) ? measurement_.q[k] : 0.0;
    }
    for (auto & each : sent_) {
      std::copy_n(command_.u, JOINTS, each.begin());
    }
    oldest_ = 0;
    std::copy_n(command_.u, JOINTS, measurement_.applied);
    reference_interfaces_.assign(REFERENCES.size() * JOINTS, 0.0);
    std::copy_n(measurement_.q, JOINTS, reference_interfaces_.begin());
    if (take_over_ticks_ == 0) {
      @{name}_init(&state_, &parameters_, &measurement_, &command_);
    } else {
      refer();
      @{name}_take_over(&state_, &parameters_, &reference_, &measurement_, &command_, take_over_ticks_);
    }
    if ((state_.status & @{macro}_NOT_FINITE) != 0) {
      RCLCPP_ERROR(logger, "the controller cannot begin from this measurement: its state would be infinite or not a number");
      return CallbackReturn::ERROR;
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    for (std::size_t k = 0; k < command_interfaces_.size(); ++k) {
      if (!is_position(k) && !command_interfaces_[k].set_value(0.0)) {
        RCLCPP_ERROR(get_node()->get_logger(), "%s could not be set to 0", command_interfaces_[k].get_name().c_str());
        return CallbackReturn::ERROR;
      }
    }
    return CallbackReturn::SUCCESS;
  }

protected:
  std::vector<hardware_interface::CommandInterface> on_export_reference_interfaces() override
  {
    reference_interfaces_.assign(REFERENCES.size() * JOINTS, NOTHING);
    std::vector<hardware_interface::CommandInterface> interfaces;
    for (std::size_t i = 0; i < reference_interfaces_.size(); ++i) {
      const std::string prefix = std::string(get_node()->get_name()) + "/" + joints_[i % JOINTS];
      interfaces.emplace_back(prefix, REFERENCES[i / JOINTS], &reference_interfaces_[i]);
    }
    return interfaces;
  }

  // Without a controller in front, the last wanted position is held.
  bool on_set_chained_mode(bool) override
  {
    for (std::size_t i = JOINTS; i < reference_interfaces_.size(); ++i) {
      reference_interfaces_[i] = 0.0;
    }
    return true;
  }

  return_type update_reference_from_subscribers(const rclcpp::Time &, const rclcpp::Duration &) override
  {
    return return_type::OK;
  }

  return_type update_and_write_commands(const rclcpp::Time &, const rclcpp::Duration &) override
  {
    if (!measure()) {
      return return_type::ERROR;
    }
    refer();
    std::copy_n(sent_[oldest_].begin(), JOINTS, measurement_.applied);
    const std::uint32_t status = @{name}_step(&state_, &parameters_, &reference_, &measurement_, &command_);
    if ((status & @{macro}_NOT_FINITE) != 0) {
      const auto bad = std::find_if_not(
        reference_interfaces_.begin(), reference_interfaces_.end(), [](double value) { return std::isfinite(value); });
      const auto i = static_cast<std::size_t>(bad - reference_interfaces_.begin());
      const bool found = bad != reference_interfaces_.end();
      RCLCPP_ERROR(
        get_node()->get_logger(), "%s%s%s is infinite or not a number", found ? joints_[i % JOINTS].c_str() : "the command",
        found ? "/" : "", found ? REFERENCES[i / JOINTS].c_str() : "");
      return return_type::ERROR;
    }
    for (std::size_t k = 0; k < JOINTS; ++k) {
      const double low = is_position(k) ? parameters_.position_low[k] : -parameters_.command_limit[k];
      const double high = is_position(k) ? parameters_.position_high[k] : parameters_.command_limit[k];
      sent_[oldest_][k] = std::min(std::max(command_.u[k], low), high);
      if (!command_interfaces_[k].set_value(sent_[oldest_][k])) {
        RCLCPP_ERROR(get_node()->get_logger(), "%s could not be set", command_interfaces_[k].get_name().c_str());
        return return_type::ERROR;
      }
    }
    oldest_ = (oldest_ + 1) % sent_.size();
    return return_type::OK;
  }

private:
  static constexpr double NOTHING = std::numeric_limits<double>::quiet_NaN();

  static bool is_position(std::size_t k) { return COMMANDS[k] == "position"; }

  Names command_names() const
  {
    Names names;
    for (std::size_t k = 0; k < joints_.size(); ++k) {
      names.push_back(joints_[k] + "/" + COMMANDS[k]);
    }
    return names;
  }

  Names state_names() const { return interface_names(joints_, STATES.data(), STATES.size()); }

  bool read_joints(const rclcpp::Logger & logger)
  {
    joints_ = get_node()->get_parameter("joints").as_string_array();
    const Names own(NAMES.begin(), NAMES.end());
    Names sorted = joints_, own_sorted = own;
    std::sort(sorted.begin(), sorted.end());
    std::sort(own_sorted.begin(), own_sorted.end());
    if (joints_.size() != JOINTS || std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end()) {
      RCLCPP_ERROR(logger, "parameter 'joints' has %zu names: expected %zu different ones", joints_.size(), JOINTS);
      return false;
    }
    if (sorted == own_sorted && joints_ != own) {
      RCLCPP_ERROR(logger, "parameter 'joints' has the arm's joints in another order: '%s' must come first", own[0].c_str());
      return false;
    }
    const std::int64_t ticks = get_node()->get_parameter("take_over_ticks").as_int();
    if (ticks < 0 || ticks > std::numeric_limits<std::uint32_t>::max()) {
      RCLCPP_ERROR(logger, "parameter 'take_over_ticks' = %lld: expected 0 or more", static_cast<long long>(ticks));
      return false;
    }
    take_over_ticks_ = static_cast<std::uint32_t>(ticks);
    return true;
  }

  bool read_fields(const rclcpp::Logger & logger)
  {
    parameters_ = @{name}_default_parameters;
    for (const Field & field : FIELDS) {
      const std::vector<double> values = get_node()->get_parameter(field.name).as_double_array();
      if (values.size() != field.count) {
        const char * what = values.empty() ? "is missing" : "has another number of values";
        RCLCPP_ERROR(logger, "parameter '%s' %s: expected %zu", field.name, what, field.count);
        return false;
      }
      for (const double value : values) {
        if (std::isnan(value) || (!field.infinite && std::isinf(value)) || (!field.negative && value < 0.0)) {
          RCLCPP_ERROR(
            logger, "parameter '%s' has the value %g: expected %s%s", field.name, value,
            field.infinite ? "numbers" : "finite numbers", field.negative ? "" : " of 0 or more");
          return false;
        }
      }
      std::memcpy(
        reinterpret_cast<unsigned char *>(&parameters_) + field.place, values.data(), field.count * sizeof(double));
    }
    return true;
  }

  // States into the controller's measurement; false, and a line in the log, if one is not a finite number.
  bool measure()
  {
    double * const targets[] = {@targets};
    for (std::size_t i = 0; i < STATES.size() * JOINTS; ++i) {
      const double value = state_interfaces_[i].get_optional().value_or(NOTHING);
      if (!std::isfinite(value)) {
        RCLCPP_ERROR(
          get_node()->get_logger(), "state interface %s is infinite or not a number: is the hardware active?",
          state_interfaces_[i].get_name().c_str());
        return false;
      }
      targets[i / JOINTS][i % JOINTS] = value;
    }
    return true;
  }

  void refer()
  {
    double * const targets[] = {@reference_targets};
    for (std::size_t i = 0; i < reference_interfaces_.size(); ++i) {
      targets[i / JOINTS][i % JOINTS] = reference_interfaces_[i];
    }
  }

  Names joints_;
  std::uint32_t take_over_ticks_ = 0;
  @{name}_parameters parameters_{};
  @{name}_state state_{};
  @{name}_measurement measurement_{};
  @{name}_reference reference_{};
  @{name}_command command_{};
  std::array<std::array<double, JOINTS>, DELAY + 1> sent_{};  // commands on their way to the drives
  std::size_t oldest_ = 0;
};
}  // namespace @name

PLUGINLIB_EXPORT_CLASS(@name::Controller, controller_interface::ChainableControllerInterface)
