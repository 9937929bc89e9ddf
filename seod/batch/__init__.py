"""The same question of many recordings: tasks, who does them, and the folder that keeps what is done.

A task is a plain function of a file and options. Executors do tasks in any order; what is written depends on
inputs and options alone.
"""
