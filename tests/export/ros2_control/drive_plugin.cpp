// drive_plugin PARAMETERS INPUTS COMMANDS RATE SCENE: what a controller manager does with the plugin, without one.
//
// PARAMETERS has a line each, "NAME int|doubles|strings COUNT VALUES". INPUTS has rows of the states in force, the references and
// the commands in force (the first row; later ones are ignored there), in the order of the interfaces. SCENE is "chained", "alone",
// or an error: "wrong-names". The exit code is 0, or the number of the callback that failed: 1 init, 2 configure, 3 activate, 4 update.

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <new>
#include <sstream>

#include "controller_interface/chainable_controller_interface.hpp"

extern "C" controller_interface::ChainableControllerInterface * make_plugin();

static unsigned long allocations = 0;

__attribute__((noinline)) void * operator new(std::size_t size)
{
  ++allocations;
  void * const place = std::malloc(size == 0 ? 1 : size);
  if (place == nullptr) {
    throw std::bad_alloc();
  }
  return place;
}
__attribute__((noinline)) void operator delete(void * place) noexcept { std::free(place); }
__attribute__((noinline)) void operator delete(void * place, std::size_t) noexcept { std::free(place); }

static std::map<std::string, rclcpp::ParameterValue> read_parameters(const char * path)
{
  std::map<std::string, rclcpp::ParameterValue> parameters;
  std::ifstream file(path);
  std::string name, type, word;
  std::size_t count = 0;
  while (file >> name >> type >> count) {
    std::vector<std::string> words(count);
    for (auto & each : words) {
      file >> each;
    }
    if (type == "int") {
      parameters.emplace(name, static_cast<std::int64_t>(std::stoll(words.at(0))));
    } else if (type == "strings") {
      parameters.emplace(name, words);
    } else {
      std::vector<double> values;
      for (const auto & each : words) {
        values.push_back(std::strtod(each.c_str(), nullptr));
      }
      parameters.emplace(name, values);
    }
  }
  return parameters;
}

int main(int argc, char ** argv)
{
  using controller_interface::CallbackReturn;
  using controller_interface::return_type;
  if (argc != 6) {
    return 99;
  }
  const std::string scene = argv[5];
  const auto rate = static_cast<unsigned int>(std::atoi(argv[4]));
  std::unique_ptr<controller_interface::ChainableControllerInterface> plugin(make_plugin());
  const auto node = std::make_shared<rclcpp_lifecycle::LifecycleNode>("law", read_parameters(argv[1]));
  const rclcpp_lifecycle::State state;
  if (plugin->init(node, rate) != CallbackReturn::SUCCESS) {
    return 1;
  }
  if (plugin->on_configure(state) != CallbackReturn::SUCCESS) {
    return 2;
  }
  auto references = plugin->export_reference_interfaces();
  const auto state_names = plugin->state_interface_configuration().names;
  const auto command_names = plugin->command_interface_configuration().names;
  std::vector<double> states(state_names.size()), commands(command_names.size()), row(
    states.size() + references.size() + commands.size());
  std::vector<hardware_interface::LoanedStateInterface> loaned_states;
  std::vector<hardware_interface::LoanedCommandInterface> loaned_commands;
  const auto split = [](const std::string & name) { return name.rfind('/'); };
  for (std::size_t i = 0; i < states.size(); ++i) {
    const std::string name = scene == "wrong-names" && i == 0 ? "other/position" : state_names[i];
    loaned_states.emplace_back(std::make_shared<hardware_interface::StateInterface>(
      name.substr(0, split(name)), name.substr(split(name) + 1), &states[i]));
    std::cout << name << "\n";
  }
  for (std::size_t i = 0; i < commands.size(); ++i) {
    const std::string & name = command_names[i];
    loaned_commands.emplace_back(std::make_shared<hardware_interface::CommandInterface>(
      name.substr(0, split(name)), name.substr(split(name) + 1), &commands[i]));
    std::cout << name << "\n";
  }
  for (const auto & each : references) {
    std::cout << each->get_name() << "\n";
  }
  plugin->assign_interfaces(std::move(loaned_commands), std::move(loaned_states));
  std::ifstream inputs(argv[2], std::ios::binary);
  std::ofstream outputs(argv[3], std::ios::binary);
  const auto next = [&]() {
    return static_cast<bool>(
      inputs.read(reinterpret_cast<char *>(row.data()), static_cast<std::streamsize>(row.size() * sizeof(double))));
  };
  if (!next()) {
    return 99;
  }
  std::copy_n(row.begin(), states.size(), states.begin());
  std::copy_n(row.end() - static_cast<long>(commands.size()), commands.size(), commands.begin());
  if (plugin->on_activate(state) != CallbackReturn::SUCCESS) {
    return 3;
  }
  plugin->set_chained_mode(scene == "chained");
  const rclcpp::Time time(0);
  const rclcpp::Duration period(0, 1000000000u / rate);
  int failed = 0;
  while (failed == 0 && next()) {
    std::copy_n(row.begin(), states.size(), states.begin());
    for (std::size_t i = 0; scene == "chained" && i < references.size(); ++i) {
      if (!references[i]->set_value(row[states.size() + i])) {
        return 99;
      }
    }
    const unsigned long before = allocations;
    failed = plugin->update(time, period) == return_type::OK ? 0 : 4;
    if (failed == 0 && allocations != before) {
      return 5;
    }
    outputs.write(
      reinterpret_cast<const char *>(commands.data()), static_cast<std::streamsize>(commands.size() * sizeof(double)));
  }
  if (plugin->on_deactivate(state) != CallbackReturn::SUCCESS) {
    return 6;
  }
  outputs.write(
    reinterpret_cast<const char *>(commands.data()), static_cast<std::streamsize>(commands.size() * sizeof(double)));
  return failed;
}
