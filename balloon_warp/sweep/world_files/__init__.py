"""Trajectories of a batch: a file for each world, beside the tables.

options    where they go, and how
tracks     what of a simulator's frame goes into them, with units and meanings
contents   what stands in the file of a world
splits     which worlds are for training, validation and test
writer     frames as they come, into the files of all worlds
moments    mean and deviation of what moves, for training
catalog    the manifest of the folder
"""
