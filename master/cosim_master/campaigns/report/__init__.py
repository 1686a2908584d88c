"""A report on a campaign as one HTML page.

page        writes it
tables      its tables: numbers, sensitivity, outliers, failures
drawing     its figures: curves and heat maps
analysis    the numbers behind them
"""
