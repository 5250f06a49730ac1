"""A robot file from a URDF: reading it, what rolls and what is held, the text of the file, and a comparison
of its mass matrix.

document.read -> Document -> recognition.recognize -> Layout -> text.robot_file -> str;  comparison.compare ->
                                                                                         differences
"""
