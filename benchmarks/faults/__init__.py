"""The fault campaign: python -m wayfield.benchmarks.faults

Random settings and actions under bounds checking, damaged files, kills, crowded and foreign folders, full disks and
wrong command lines, until the time is over. Every group is a module with `trials`, an endless or finite stream of JSON
objects drawn from a random generator with what once went wrong first, and `attempt`, which does one of them and says
what is wrong with the outcome. Everything runs on a copy of the package, in processes that end with this one.
"""
