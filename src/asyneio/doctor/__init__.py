"""Is a recording usable, and if not, what is to be done?"""
